"""Lines of numbers, block by block: so a text of any length is read in little more than its "
"arrays."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from furcl.errors import GroomError
from furcl.values import shown

BLOCK_BYTES = 1 << 21
#: Longer lines are none of a few numbers.
LONGEST_LINE = 1 << 16
_SPACE = np.zeros(256, bool)
_SPACE[list(b" \t\r\n\v\f")] = True


@dataclass(frozen=True, eq=False)
class Rows:
    """The numbers of some lines.

    Attributes
    ----------
    values : (n,) float64       all of them, line after line
    counts : (k,) int64         how many each line has; 0 of an empty one
    line : int                  number of the first of these lines in its file, from 1
    """

    values: NDArray[np.float64]
    counts: NDArray[np.int64]
    line: int


def number_rows(file: BinaryIO, path: Path, what: str) -> Iterator[Rows]:
    """The lines of a file from where it stands.

    Parameters
    ----------
    what : str          what a line should hold, for messages

    Raises
    ------
    GroomError          what is no number, with its line; a line longer than LONGEST_LINE
    """
    rest, line = b"", 1
    while True:
        block = file.read(BLOCK_BYTES)
        cut = block.rfind(b"\n") + 1 if block else 0
        text, left = (rest + block[:cut], block[cut:]) if cut else (rest, block)
        if not cut and block:
            rest += block
            text = b""
        else:
            rest = left
        if len(rest) > LONGEST_LINE:
            raise GroomError(
                f"{path}: line {line + text.count(10)} has more than {LONGEST_LINE} letters; "
                f"{what}. Is it another format?"
            )
        if text:
            rows = _rows(text, line, path, what)
            yield rows
            line += len(rows.counts)
        if not block:
            return


def _rows(text: bytes, line: int, path: Path, what: str) -> Rows:
    letters = np.frombuffer(text, np.uint8)
    space = _SPACE[letters]
    begins = ~space
    begins[1:] &= space[:-1]
    ends = np.flatnonzero(letters == 10)
    if text[-1:] != b"\n":
        ends = np.append(ends, len(text) - 1)
    before = np.concatenate([[0], np.searchsorted(np.flatnonzero(begins), ends, side="right")])
    counts = np.diff(before)
    n = int(before[-1])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # numpy 2.0 warns and goes on
            values = np.fromstring(text, np.float64, sep=" ") if n else np.zeros(0)
    except ValueError:
        _refuse(text, line, path, what)
    if len(values) != n:
        _refuse(text, line, path, what)
    return Rows(values, counts, line)


def _refuse(text: bytes, line: int, path: Path, what: str) -> NoReturn:
    for number, each in enumerate(text.split(b"\n"), line):
        for word in each.split():
            try:
                float(word)
            except ValueError:
                found = shown(word.decode("latin-1"))
                raise GroomError(
                    f"{path}: line {number}: {found} is no number; {what}. Repair the file, or is "
                    "it another format?"
                ) from None
    raise GroomError(f"{path}: from line {line}: {what}. Repair the file.")
