"""Damaged files in slices that go on where the last run ended.

`python -m faults.slices FILE` reads a hundredth of every kind in turn, again and again, and adds a
line to FILE for each; started again, it goes on after the last. `python -m faults.slices FILE
--table` prints what was read so far.
"""

from __future__ import annotations

import json
import logging
import resource
import sys
import tempfile
import warnings
from collections import defaultdict
from pathlib import Path

from faults import mutants

SLICES = 100
SEED = 1


def read_on(file: Path) -> None:
    """Read what is not in the file yet, by one process."""
    done = {(line["kind"], line["slice"]) for line in _lines(file)}
    logging.disable()
    # numpy warns of headers that Python 2 may have written, which some damage looks like.
    warnings.filterwarnings("ignore", "Reading", UserWarning)
    with tempfile.TemporaryDirectory(prefix="furcl-mutants-") as folder:
        mutants.FOLDER = Path(folder)
        for number in range(SLICES):
            for kind, n in mutants.FULL.items():
                if (kind, number) in done:
                    continue
                first, end = (n * k // SLICES for k in (number, number + 1))
                wrong, refused = "", 0
                try:
                    refused = mutants.read_mutants(kind, first, end, SEED, Path(folder))
                except AssertionError as error:
                    wrong = str(error)
                peak = max(
                    resource.getrusage(who).ru_maxrss
                    for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
                )
                line = {"kind": kind, "slice": number, "n": end - first, "refused": refused}
                line |= {"peak_mb": peak // 1024, "wrong": wrong}
                with file.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(line) + "\n")


def table(file: Path) -> None:
    """Print a row for each kind, and the sum."""
    read: dict[str, int] = defaultdict(int)
    refused: dict[str, int] = defaultdict(int)
    wrong: dict[str, str] = {}
    peak = 0
    for line in _lines(file):
        read[line["kind"]] += line["n"]
        refused[line["kind"]] += line["refused"]
        peak = max(peak, line["peak_mb"])
        if line["wrong"]:
            wrong[line["kind"]] = line["wrong"]
    for kind, n in read.items():
        verdict = "**WRONG**" if kind in wrong else "ok"
        said = wrong.get(kind, f"{n} files, {refused[kind]} refused")
        print(f"| mutants | damaged files: {kind} | {said} | {verdict} |")
    total = f"{sum(read.values())} files of {len(read)} kinds, at most {peak} MB"
    print(f"| mutants | all | {total} | {'**WRONG**' if wrong else 'ok'} |")


def _lines(file: Path) -> list[dict]:
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


if __name__ == "__main__":
    (table if "--table" in sys.argv else read_on)(Path(sys.argv[1]))
