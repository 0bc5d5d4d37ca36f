"""Strands that are there twice: a groom merged with itself, or a tuft exported with two others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def copied_strands(
    points: NDArray[np.float32],
    radii: NDArray[np.float32],
    offsets: NDArray[np.int64],
    steps: NDArray[np.float32] | None = None,
) -> NDArray[np.int64]:
    """Strands with the same points and radii, to the bit and in the same order, as an earlier one.

    A second fibre at the very place of a first adds no matter. To a path tracer it would: a ray
    that leaves the one would begin on the axis of the other, and rounding decide whether it hits.
    Strands that are not the same to the bit are two, however near: they scatter as two fibres do
    that are in each other.

    Parameters
    ----------
    points : (n, 3) float32, radii : (n,) float32, offsets : (s + 1,) int64
        as of furcl.groom.curves.Curves
    steps : (T, n, 3) float32 or None   of a groom that moves: copies are the same in all of them

    Returns
    -------
    (k,) int64      numbers of the strands, increasing
    """
    key = _key(points, offsets)
    ordered = np.sort(key)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(repeated):
        return np.zeros(0, np.int64)
    known: set[bytes] = set()
    copies = []
    for strand in np.flatnonzero(np.isin(key, repeated)):
        part = slice(offsets[strand], offsets[strand + 1])
        places = points[part] if steps is None else steps[:, part]
        content = places.tobytes() + radii[part].tobytes()
        if content in known:
            copies.append(strand)
        known.add(content)
    return np.array(copies, np.int64)


def _key(points: NDArray[np.float32], offsets: NDArray[np.int64]) -> NDArray[np.uint64]:
    """A number a strand that is the same for copies and rarely for others, (s,)."""
    key = np.diff(offsets).astype(np.uint64)
    for end in (offsets[:-1], offsets[1:] - 1, (offsets[:-1] + offsets[1:]) // 2):
        words = np.ascontiguousarray(points[end]).view(np.uint32)
        for axis in range(3):
            key = (key ^ words[:, axis]) * np.uint64(0x9E3779B97F4A7C15)
            key ^= key >> np.uint64(29)
    return key
