"""The pages of all results in a folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from jinja2 import TemplateError

from furcl.errors import BenchError, FurclError
from furcl.files import read_text
from furcl.report import convergence, stability
from furcl.values import shown

# What the pages raise on results that lack something, or hold something else.
_WRONG_CONTENT = (LookupError, TypeError, ValueError, AttributeError, TemplateError)


def write_pages(
    folder: str | Path, *, metrics: Sequence[str] = ("rmse",), scenes: Sequence[str] = ()
) -> list[Path]:
    """Make the page and plots beside every results.json in a folder that has one.

    Parameters
    ----------
    folder : path
    metrics, scenes : list of str       of figures of convergence: `convergence.write_report`

    Returns
    -------
    list of Path    the pages, by the names of their folders

    Raises
    ------
    BenchError      if there are none, or a results.json cannot be read
    """
    pages = []
    for path in sorted(Path(folder).rglob("results.json")):
        try:
            schema = str(json.loads(read_text(path)).get("schema"))
        except (OSError, ValueError, AttributeError, RecursionError) as error:
            raise BenchError(f"{path}: cannot be read: {error}; run the benchmark again") from None
        benchmark = schema.rpartition("-")[0]
        try:
            if benchmark == "furcl-convergence":
                page = convergence.write_report(path.parent, metrics=metrics, scenes=scenes)
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
    if not pages:
        raise BenchError(
            f"{folder}: holds no results of `furcl bench convergence` or `furcl bench stability`, "
            f"the two that have pages; give a folder in which one of them wrote a results.json"
        )
    return pages
