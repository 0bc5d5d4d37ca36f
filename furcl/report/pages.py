"""The pages of all results in a folder."""

from __future__ import annotations

import json
from pathlib import Path

from furcl.errors import BenchError
from furcl.files import read_text
from furcl.report import convergence, stability

# Benchmarks that have a page; the others print their tables.
WRITERS = {
    "furcl-convergence": convergence.write_report,
    "furcl-stability": stability.write_report,
}


def write_pages(folder: str | Path) -> list[Path]:
    """Make the page and plots beside every results.json in a folder that has one.

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
        except (OSError, ValueError, AttributeError) as error:
            raise BenchError(f"{path}: cannot be read: {error}; run the benchmark again") from None
        writer = WRITERS.get(schema.rpartition("-")[0])
        if writer:
            pages.append(writer(path.parent))
    if not pages:
        raise BenchError(
            f"{folder}: holds no results of `furcl bench convergence` or `furcl bench stability`, "
            f"the two that have pages; give a folder in which one of them wrote a results.json"
        )
    return pages
