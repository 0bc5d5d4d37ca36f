"""Absorptions of strands or points, a word each, as kernels/include/fibre/absorption.clh reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import Absorption as By
from furcl.fibre.absorption import Absorption
from furcl.fibre.model import FibreModel
from furcl.groom.joined import Grooms

RANK_VERTICES = 256
LEVELS = np.array([2047, 2047, 1023])
"""The largest number of each channel in a word; shifts of the channels are 0, 11 and 22."""


@dataclass(frozen=True, eq=False)
class Packed:
    """The absorption of the strands of a material.

    Attributes
    ----------
    by : str                    "strand" or "point" have values; "constant": all are the same
    sigma : (r, g, b)           the largest of each channel [1/fibre radius]
    absorbs : (low, high)       smallest and largest of all channels
    grey : bool                 whether channels are equal everywhere
    words : (n,) uint32         the buffer
    """

    by: By
    sigma: tuple[float, float, float]
    absorbs: tuple[float, float]
    grey: bool
    words: NDArray[np.uint32]


def bind(
    absorption: Absorption, model: FibreModel, fibre: Any, grooms: Grooms, material: int
) -> Packed:
    """What a material's absorption is in its grooms, as rays meet them.

    Square roots are rounded to 1/2047 of the largest one in red and green, 1/1023 in blue.

    Raises
    ------
    GroomError, FibreError      as `Absorption.roots`
    """
    own = grooms.of_material(material)
    parts = [absorption.roots(groom.curves, model, fibre, groom.name) for groom in own]
    of_points = any(
        len(part) != groom.curves.n_strands for part, groom in zip(parts, own, strict=True)
    )
    if of_points:
        parts = [
            np.repeat(part, np.diff(groom.curves.offsets), axis=0)
            if len(part) == groom.curves.n_strands
            else part
            for part, groom in zip(parts, own, strict=True)
        ]
    roots = np.concatenate(parts)
    most = float(roots.max())
    grey = bool((roots == roots[:, :1]).all())
    if (roots == roots[0]).all():
        red, green, blue = np.square(roots[0], dtype=np.float64).tolist()
        sigma = (red, green, blue)
        return Packed("constant", sigma, (min(sigma), max(sigma)), grey, np.zeros(0, np.uint32))
    levels = np.rint(roots * (LEVELS / most)).astype(np.uint32)
    values = levels[:, 0] | levels[:, 1] << np.uint32(11) | levels[:, 2] << np.uint32(22)
    ends = [levels.min(axis=0), levels.max(axis=0)]
    low, high = (np.square(level / LEVELS * most) for level in ends)
    first = grooms.grooms.index(own[0])
    ranks = np.zeros(0, np.uint32)
    first_vertex = grooms.first_points[first]
    if not of_points:
        ranks = _ranks(grooms, first_vertex, grooms.first_strands[first], own)
    header = np.array([0, len(values), first_vertex, len(ranks)], np.uint32)
    header[:1] = np.array([most], np.float32).view(np.uint32)
    red, green, blue = high.tolist()
    return Packed(
        "point" if of_points else "strand",
        (red, green, blue),
        (float(low.min()), float(high.max())),
        grey,
        np.concatenate([header, ranks, values]),
    )


def _ranks(
    grooms: Grooms, first_vertex: int, first_strand: int, own: Sequence[Any]
) -> NDArray[np.uint32]:
    """Of each block of vertices how many strands of the material end before it; less than none,
    modulo 2^32, where others end in the block before the material's first."""
    n = sum(groom.curves.n_points for groom in own)
    blocks = np.arange(first_vertex // RANK_VERTICES, (first_vertex + n - 1) // RANK_VERTICES + 1)
    before = np.searchsorted(grooms.curves.offsets[1:] - 1, blocks * RANK_VERTICES)
    return (before - first_strand).astype(np.int64).astype(np.uint32)
