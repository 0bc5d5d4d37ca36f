"""The pages of all results in a folder."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path

from jinja2 import TemplateError

from furcl.errors import BenchError, FurclError
from furcl.files import read_text
from furcl.report import convergence, stability
from furcl.values import shown

log = logging.getLogger(__name__)

# What the pages raise on results that lack something, or hold something else.
_WRONG_CONTENT = (LookupError, TypeError, ValueError, AttributeError, TemplateError)


def write_pages(
    *folders: str | Path, metrics: Sequence[str] = ("rmse",), scenes: Sequence[str] = ()
) -> list[Path]:
    """Make the page and plots beside every results.json in folders that has one.

    Parameters
    ----------
    folders : paths
    metrics, scenes : list of str       of figures of convergence: `convergence.write_report`; of
                                        each run the scenes that it has, and none of one without

    Returns
    -------
    list of Path    the pages, by the names of their folders

    Raises
    ------
    BenchError      if a folder has none, a results.json cannot be read, or no run has a scene
    """
    pages, there = [], dict[str, None]()
    for folder in folders:
        found = _pages_in(Path(folder), metrics, scenes, there)
        if not found:
            raise BenchError(
                f"{folder}: holds no results of `furcl bench convergence` or `furcl bench "
                f"stability`, the two that have pages; give a folder in which one of them wrote a "
                f"results.json"
            )
        pages += [page for page in found if page]
    for name in scenes:
        if name not in there:
            raise BenchError(
                f"scene {name!r}: not in the results; allowed are {', '.join(there) or 'none'}"
            )
    return pages


def _pages_in(
    folder: Path, metrics: Sequence[str], scenes: Sequence[str], there: dict[str, None]
) -> list[Path | None]:
    """The pages of the results in a folder, None for those without any of the scenes; `there` takes
    the names of all scenes."""
    pages: list[Path | None] = []
    for path in sorted(folder.rglob("results.json")):
        try:
            results = json.loads(read_text(path))
            schema = str(results.get("schema"))
        except (OSError, ValueError, AttributeError, RecursionError) as error:
            raise BenchError(f"{path}: cannot be read: {error}; run the benchmark again") from None
        benchmark = schema.rpartition("-")[0]
        try:
            if benchmark == "furcl-convergence":
                own = [scene["name"] for scene in results["scenes"]]
                there.update(dict.fromkeys(own))
                chosen = [name for name in scenes if name in own]
                if scenes and not chosen:
                    log.info("%s: has none of the scenes %s", path, ", ".join(scenes))
                    pages.append(None)
                    continue
                page = convergence.write_report(path.parent, metrics=metrics, scenes=chosen)
            elif benchmark == "furcl-stability":
                page = stability.write_report(path.parent)
            else:
                continue
            pages.append(page)
        except FurclError:
            raise
        except _WRONG_CONTENT as error:
            raise BenchError(
                f"{path}: not whole results: {type(error).__name__}: {shown(str(error))}; it was "
                f"edited or damaged, run the benchmark again"
            ) from error
    return pages
