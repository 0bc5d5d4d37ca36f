"""What the tables of docs/ are made with: results of runs, Markdown, the marks around tables."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "results"

Results = dict[str, Any]
Tables = Mapping[str, Callable[[], str]]


def load(name: str) -> Results:
    """The results of one run, by its path in FOLDER."""
    return json.loads((FOLDER / name).read_text())


def runs(kind: str, folder: Path = FOLDER) -> list[Results]:
    """The results of all runs of a benchmark, by the names of their folders."""
    return [json.loads(path.read_text()) for path in sorted((folder / kind).glob("*/results.json"))]


def table(columns: list[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table, first column to the left."""
    lines = [columns, ["---", *["---:"] * (len(columns) - 1)], *map(list, rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def driver(results: Results) -> str:
    """Runtime and version of a run's device, short; of a GPU its name."""
    device = results["device"]
    maker = device["platform"].split()[0].removesuffix("(R)")
    if maker == "Portable":
        return f"PoCL {device['driver'].partition('+')[0]}"
    if maker in ("NVIDIA", "AMD"):
        return f"{device['name']} ({device['driver']})"
    return f"{maker} {'.'.join(device['driver'].split('.')[:2])}"


def circumstances(*found: Results) -> str:
    """Device, machine, date and commit of runs, once where they are the same, and the commands."""
    commands: dict[str, list[str]] = {}
    for results in found:
        machine = results["machine"]
        shared = f"{results['workers']} workers with " if "workers" in results else ""
        where = (
            f"{shared}{driver(results)} on {machine['processor']}, {machine['cores']} cores, "
            f"{results['date']}, commit {results.get('git', 'unknown')}:"
        )
        commands.setdefault(where, []).append(f"    {results['command']}")
    return "\n\n".join("\n".join([where, "", *lines]) for where, lines in commands.items())


def filled(text: str, tables: Tables) -> str:
    """A document with every table made anew between its marks.

    Raises
    ------
    ValueError      a table whose marks are not there exactly once
    """
    for name, make in tables.items():
        pattern = rf"(<!-- {name} -->\n).*?(<!-- end -->)"
        text, count = re.subn(
            pattern, lambda m, make=make: f"{m[1]}\n{make()}\n\n{m[2]}", text, flags=re.DOTALL
        )
        if count != 1:
            raise ValueError(f"<!-- {name} --> ... <!-- end --> is there {count} times, not once")
    return text
