"""What readers of mesh files in text share: blocks of lines, numbers, polygons cut into triangles.

A block is read, made into arrays and forgotten: what a text takes does not grow with its file.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

BLOCK_CHARACTERS = 1 << 19


def blocks(file: TextIO, carries_on: str = "") -> Iterator[tuple[int, list[str]]]:
    """Whole lines of a file, some at a time, with the number of the first of them.

    Parameters
    ----------
    carries_on : str        a line that ends so goes on in the next, and both count as one

    Raises
    ------
    ValueError      a line that is longer than a block
    """
    number, rest = 1, ""
    while chunk := file.read(BLOCK_CHARACTERS):
        text = rest + chunk
        if carries_on and carries_on in text:
            text = text.replace(f"{carries_on}\n", " ")
        # A line may go on at the end of a block.
        whole, newline, rest = text.rpartition("\n")
        if len(rest) > BLOCK_CHARACTERS:
            raise ValueError(f"a line of more than {BLOCK_CHARACTERS} characters")
        if newline:
            lines = whole.split("\n")
            yield number, lines
            number += len(lines)
    if rest:
        yield number, [rest]


class Rows:
    """An array (n, ...) that grows at its end, where it is: two copies are never held.

    Attributes
    ----------
    n : int     rows that it has
    """

    def __init__(self) -> None:
        self.n = 0
        self._rows: NDArray[Any] = np.empty(0)

    def append(self, rows: NDArray[Any]) -> None:
        """Add rows, all of one shape and type."""
        end = self.n + len(rows)
        if not self.n:
            self._rows = np.empty((0, *rows.shape[1:]), rows.dtype)
        if end > len(self._rows):
            self._resize(end + end // 8)
        self._rows[self.n : end] = rows
        self.n = end

    def array(self) -> NDArray[Any]:
        """All rows, after which there can be no more."""
        self._resize(self.n)
        return self._rows

    def _resize(self, n: int) -> None:
        self._rows.resize((n, *self._rows.shape[1:]), refcheck=False)


def numbers(words: Sequence[str], dtype: Any = np.float64) -> NDArray[Any]:
    """The numbers (n,) that words stand for.

    Raises
    ------
    ValueError      one of them is none
    """
    found = np.fromstring(" ".join(words), dtype, sep=" ") if words else np.empty(0, dtype)
    if len(found) != len(words):
        raise ValueError("a word that is no number")
    return found


def fans(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Polygons whose corners follow each other, cut into triangles from their first corners.

    Parameters
    ----------
    counts : (n,)       corners of each polygon, 3 or more

    Returns
    -------
    (m, 3)              corners of the triangles, counted over all polygons
    """
    pieces = counts - 2
    first = np.repeat(np.cumsum(counts) - counts, pieces)
    step = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return np.stack([first, first + step + 1, first + step + 2], axis=1)
