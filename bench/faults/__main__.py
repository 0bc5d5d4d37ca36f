"""Run all cases, or those of some topics or names, and print what happens: bash bench/faults.sh."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import sys
import tempfile
import traceback
from pathlib import Path

import faults
from faults.case import Case, NotHereError

LONGEST = 240


def topics() -> dict[str, list[Case]]:
    """Topic -> its cases, of every file of this folder that has a list CASES."""
    names = [module.name for module in pkgutil.iter_modules(faults.__path__)]
    modules = {n: importlib.import_module(f"faults.{n}") for n in names if n != "__main__"}
    return {n: module.CASES for n, module in modules.items() if hasattr(module, "CASES")}


def outcome(case: Case, quick: bool) -> tuple[str, bool | None]:
    """What happened, in one line, and whether it is right; None: it cannot be tried here."""
    with tempfile.TemporaryDirectory(prefix="furcl-fault-") as folder:
        try:
            return case.run(Path(folder), quick).replace(folder, "DIR")[:LONGEST], True
        except NotHereError as error:
            return str(error), None
        except AssertionError as error:
            lines = str(error).strip().splitlines() or ["an assertion fails"]
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            lines = [
                f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
            ]
        return lines[0][:LONGEST], False


def _chosen(words: list[str]) -> list[tuple[str, Case]]:
    """The cases of some topics, or with some words in their names, each with its topic."""
    every = topics()
    return [
        (topic, case)
        for topic, cases in every.items()
        for case in cases
        if not words or any(w == topic if w in every else w in case.name for w in words)
    ]


def main() -> int:
    """Print the table as it grows; 1 if a case goes wrong."""
    parser = argparse.ArgumentParser(prog="bash bench/faults.sh", description=__doc__)
    parser.add_argument("words", nargs="*", help="topics, or parts of names; none: all")
    parser.add_argument("--quick", action="store_true", help="the short form of make test")
    given = parser.parse_args()
    chosen = _chosen(given.words)
    print("| topic | case | what happens | verdict |\n|---|---|---|---|")
    wrong = left_out = 0
    for topic, case in chosen:
        said, right = outcome(case, given.quick)
        wrong += right is False
        left_out += right is None
        verdict = {True: "ok", False: "**WRONG**", None: "not tried"}[right]
        print(f"| {topic} | {case.name} | {said.replace('|', '/')} | {verdict} |", flush=True)
    print(f"\n{len(chosen)} cases, {wrong} wrong, {left_out} not tried", file=sys.stderr)
    return 1 if wrong or not chosen else 0


if __name__ == "__main__":
    sys.exit(main())
