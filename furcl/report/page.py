"""What the pages of all benchmarks share: reading results and filling a template."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jinja2

from furcl.errors import BenchError
from furcl.files import atomic_path, read_text


def load_results(folder: Path, benchmark: str) -> dict[str, Any]:
    """The results.json of a folder; BenchError if it is not that of `furcl bench BENCHMARK`."""
    path = folder / "results.json"
    try:
        results = json.loads(read_text(path))
    except (OSError, ValueError) as error:
        raise BenchError(
            f"{path}: cannot be read: {error}; give the folder of a `furcl bench {benchmark}`"
        ) from None
    if not str(results.get("schema", "")).startswith(f"furcl-{benchmark}"):
        raise BenchError(f"{path}: not the results of `furcl bench {benchmark}`")
    return results


def write_page(
    folder: Path, template: str, filters: dict[str, Callable[..., Any]], **values: Any
) -> Path:
    """Fill a template of furcl/report and write it as index.html, whole or not at all.

    Names that a template uses and `values` lack are errors.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("furcl.report", ""),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(filters)
    page = environment.get_template(template).render(**values)
    path = folder / "index.html"
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path
