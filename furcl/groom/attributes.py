"""Named arrays of values that strands carry: one value a strand, or one a point."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import GroomError

Attributes = Mapping[str, NDArray[np.float32]]

RESERVED = ("points", "radii", "radius", "offsets", "counts", "times")
"""Names of arrays that are no attributes."""

CLUMP = "clump"
"""The attribute of strands that generators which make clumps give them."""


def clump_values(clump: NDArray[np.integer]) -> NDArray[np.float32]:
    """Numbers in [0, 1) of strands (S,) by the numbers of their clumps, alike within a clump.

    Clumps are spread evenly over the range, in no order: multiples of the golden ratio modulo 1.
    """
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    return np.minimum(np.float32(np.modf(clump * golden)[0]), np.float32(1.0 - 2.0**-24))


def checked_values(
    given: Mapping[str, ArrayLike],
    offsets: NDArray[np.int64],
    grid: tuple[int, ...] | None,
    source: str,
) -> dict[str, NDArray[np.float32]]:
    """Arrays as float32 values of points (N,), (N, 3) or of strands (S,), (S, 3).

    Parameters
    ----------
    given : mapping             name -> values
    offsets : (S + 1,) int64    as of furcl.groom.curves.Curves
    grid : (S, K) or None       of strands of K points, whose values may have that shape; an array
                                (S, 3) is of strands, also for K = 3

    Raises
    ------
    GroomError      names the source and the array, and the place of a value that is not finite
    """
    found = {}
    n_strands, n_points = len(offsets) - 1, int(offsets[-1])
    for name, array in given.items():
        try:
            values = np.asarray(array)
        except (TypeError, ValueError) as error:
            raise GroomError(f"{source}: {name} is no array: {error}. Give numbers.") from None
        if name in RESERVED or not name:
            raise GroomError(
                f"{source}: attribute {name!r}: that name has another meaning; choose one that is "
                f"none of {', '.join(RESERVED)}."
            )
        if values.dtype.kind not in "fiub":
            raise GroomError(
                f"{source}: {name} has type {values.dtype}; expected real numbers. Convert it, or "
                f"leave it out."
            )
        rows = value_rows(values.shape, n_strands, n_points, grid)
        scalar = rows is not None and values.size != 3 * rows
        if rows is None or (name == "colours" and scalar):
            shapes = f"({n_points}, 3) of points or ({n_strands}, 3) of strands"
            if name != "colours":
                shapes += f", or ({n_points},) or ({n_strands},)"
            raise GroomError(f"{source}: {name} has shape {values.shape}; expected {shapes}.")
        with np.errstate(over="ignore", under="ignore"):
            values = np.ascontiguousarray(values, np.float32).view()
        values = values.reshape(rows) if scalar else values.reshape(rows, 3)
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values).reshape(rows, -1).all(axis=1)))
            raise GroomError(
                f"{_place(row, rows == n_points, offsets, source)}: {name} is not finite; repair "
                f"or leave out that array."
            )
        found[name] = values
    return found


def value_rows(
    shape: tuple[int, ...], n_strands: int, n_points: int, grid: tuple[int, ...] | None = None
) -> int | None:
    """Points or strands that an array of that shape has values of; None: of neither.

    `grid` as for `checked_values`.
    """
    if shape in ((n_strands,), (n_strands, 3)):
        return n_strands
    if shape in ((n_points,), (n_points, 3)):
        return n_points
    return n_points if grid and shape in (grid, (*grid, 3)) else None


def kept_values(
    attributes: Attributes, offsets: NDArray[np.int64], kept: NDArray[np.integer]
) -> dict[str, NDArray[np.float32]]:
    """The values of those points that are left, and of the strands with any.

    Parameters
    ----------
    attributes : mapping        as of furcl.groom.curves.Curves, with `offsets`
    kept : (n,)                 points, increasing
    """
    found, strands = {}, None
    for name, values in attributes.items():
        if len(values) == offsets[-1]:
            found[name] = values[kept]
        else:
            if strands is None:
                strands = np.unique(np.searchsorted(offsets, kept, side="right") - 1)
            found[name] = values[strands]
    return found


def _place(row: int, of_point: bool, offsets: NDArray[np.int64], source: str) -> str:
    if not of_point:
        return f"{source}: strand {row}"
    strand = int(np.searchsorted(offsets, row, side="right")) - 1
    return f"{source}: strand {strand}, point {row - int(offsets[strand])}"
