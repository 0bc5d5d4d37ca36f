"""How much of a groom lies before a ray: optical depths on a grid, in 26 directions."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.groom.curves import Curves

VOXELS_ON_THE_LONGEST_SIDE = 32
# Of larger grooms every so many-th segment stands for those up to the next, and again where
# segments have more parts, of the size of voxels, than two each.
MOST_SEGMENTS = 1 << 17
# Of a cylinder in all directions alike, over length times width.
MEAN_SHADOW = np.pi / 4

#: The 26 directions from a voxel to its neighbours, (26, 3), and between them, in the 14th place,
#: none: direction d is at (d + 1) @ (9, 3, 1).
DIRECTIONS = np.array(list(itertools.product((-1, 0, 1), repeat=3)))


@dataclass(frozen=True, eq=False)
class OpticalDepths:
    """Optical depths from the middles of voxels to beyond the groom.

    Attributes
    ----------
    corner : (3,) float64           lowest corner of the grid [scene unit]
    voxel : float                   its side [scene unit]
    depths : (nx, ny, nz, 27) float32   in the directions DIRECTIONS, as if strands lay at random
                                    within a voxel; a ray passes unhindered with chance exp(-depth)
    """

    corner: NDArray[np.float64]
    voxel: float
    depths: NDArray[np.float32]


def optical_depths(curves: Curves, n: int = VOXELS_ON_THE_LONGEST_SIDE) -> OpticalDepths:
    """Those of a groom, on a grid with `n` voxels along the longest side of its box."""
    lo, hi = curves.bounds()
    voxel = max(float((hi - lo).max()) / n, 1e-30)
    shape = np.maximum(np.ceil((hi - lo) / voxel - 1e-6).astype(int), 1)
    extinction = _shadow_areas(curves, lo, voxel, shape) / voxel**3
    depths = np.stack([_along(extinction * voxel, d) for d in DIRECTIONS], axis=-1)
    return OpticalDepths(lo, voxel, depths)


def _shadow_areas(
    curves: Curves, corner: NDArray[np.float64], voxel: float, shape: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Mean area that the segments of each voxel hide, (nx, ny, nz); segments longer than a voxel
    are cut into parts."""
    every = -(-curves.n_segments // MOST_SEGMENTS)
    first = curves.segment_vertices()[::every]
    length = np.linalg.norm(curves.points[first + 1] - curves.points[first], axis=1)
    again = -(-int(np.ceil(length / voxel).sum()) // (2 * MOST_SEGMENTS))
    first, length, every = first[::again], length[::again].astype(np.float64), every * again
    start = curves.points[first].astype(np.float64)
    along = curves.points[first + 1] - start
    width = curves.radii[first].astype(np.float64) + curves.radii[first + 1]
    parts = np.ceil(length / voxel).astype(int)
    segment = np.repeat(np.arange(len(first)), parts)
    part = np.arange(len(segment)) - np.repeat(np.cumsum(parts) - parts, parts)
    at = start[segment] + ((part + 0.5) / parts[segment])[:, None] * along[segment]
    place = np.clip(((at - corner) / voxel).astype(int), 0, shape - 1)
    area = every * MEAN_SHADOW * (length * width / parts)[segment]
    areas = np.zeros(shape, np.float64)
    np.add.at(areas, tuple(place.T), area)
    return areas


def _along(opacity: NDArray[np.float64], direction: NDArray[np.int64]) -> NDArray[np.float32]:
    """Optical depths in one direction; `opacity` is that of a voxel's side, (nx, ny, nz)."""
    if not direction.any():
        return np.zeros(opacity.shape, np.float32)
    axis = int(np.flatnonzero(direction)[0])
    step = 0.5 * float(np.linalg.norm(direction))
    # A border of empty voxels; slabs across the axis, from the side where rays leave.
    padded = np.moveaxis(np.pad(opacity, 1), axis, 0)
    out = np.zeros_like(padded)
    inside = (slice(1, -1), slice(1, -1))
    du, dv = np.delete(direction, axis)
    shifted = tuple(
        slice(1 + d, size - 1 + d) for d, size in zip((du, dv), out.shape[1:], strict=True)
    )
    slabs = range(1, len(out) - 1)
    for k in reversed(slabs) if direction[axis] > 0 else slabs:
        beyond = k + direction[axis]
        out[k][inside] = out[beyond][shifted] + step * (padded[k][inside] + padded[beyond][shifted])
    return np.moveaxis(out, 0, axis)[1:-1, 1:-1, 1:-1].astype(np.float32)
