"""A large groom cut into chunks of neighbours, and the top of the tree over them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import (
    BLOCK_BOXES,
    BLOCK_LANES,
    BLOCK_ORIGIN,
    BLOCK_REFERENCES,
    BLOCK_STEP,
    BLOCK_WORDS,
    GRID_MARGIN,
    block_bytes,
)
from furcl.groom.curves import Curves

SAMPLES_PER_CHUNK = 1 << 12
AT_ONCE = 1 << 18
# Of a chunk's size, how much may be beyond either face of the box that all but stray segments are
# near: so these are less than half a chunk.
STRAY_SHARE = 1.0 / 16.0
NO_CHUNK = 0xFFFF  # of the last points of strands, where no segment begins
GOLDEN = 0.6180339887498949


class Partition:
    """The segments of a groom in chunks of nearly the same size, neighbours together.

    Chunks are told apart by planes: medians, across the longest axis, of the midpoints of a sample
    of some thousand segments a chunk, spread evenly over the groom. Their order is that of the tree
    of planes, as `top_lanes` expects. Segments that no plane parts stay together.

    The few segments that are far away from all others are a chunk of their own, the last one:
    one of them alone would make the box of a chunk so large that every ray meets it.

    Parameters
    ----------
    curves : Curves
    n_chunks : int      1 .. 65534

    Attributes
    ----------
    stray : bool        whether there is such a chunk
    """

    def __init__(self, curves: Curves, n_chunks: int) -> None:
        sample = _sampled_midpoints(curves, n_chunks * SAMPLES_PER_CHUNK)
        lowest, highest = _surroundings(sample, STRAY_SHARE / n_chunks)
        near = ((sample >= lowest) & (sample <= highest)).all(axis=1)
        tree = _planes(sample[near], n_chunks, 0)
        self._chunk_at = np.empty(curves.n_points, np.uint16)
        for begin in range(0, curves.n_points - 1, AT_ONCE):
            points = curves.points[begin : begin + AT_ONCE + 1].T
            doubled = points[:, :-1] + points[:, 1:]
            part = self._chunk_at[begin : begin + AT_ONCE]
            _assign(tree, doubled, np.arange(doubled.shape[1]), part)
            far = (doubled < lowest[:, None]) | (doubled > highest[:, None])
            part[np.flatnonzero(far.any(axis=0))] = n_chunks
        self._chunk_at[curves.offsets[1:] - 1] = NO_CHUNK
        self._sizes = np.bincount(self._chunk_at, minlength=NO_CHUNK)[:NO_CHUNK]
        self.stray = bool(self._sizes[n_chunks])

    @property
    def sizes(self) -> list[int]:
        """Segments of each chunk; none is empty."""
        return self._sizes[self._sizes > 0].tolist()

    def __iter__(self) -> Iterator[NDArray[np.uint32]]:
        """First vertices of the segments of each chunk."""
        for chunk in np.flatnonzero(self._sizes):
            yield np.flatnonzero(self._chunk_at == chunk).astype(np.uint32)


@dataclass(frozen=True)
class _Plane:
    """Across an axis; on either side a further plane or the number of a chunk."""

    axis: int
    value: np.float32  # twice the coordinate
    below: _Plane | int
    above: _Plane | int


def _sampled_midpoints(curves: Curves, n: int) -> NDArray[np.float32]:
    """Twice the midpoints of n segments, (n, 3)."""
    vertex = (np.arange(1, n + 1) * GOLDEN % 1.0 * curves.n_points).astype(np.int64)
    strand_end = curves.offsets[np.searchsorted(curves.offsets, vertex, side="right")]
    vertex -= vertex == strand_end - 1
    return curves.points[vertex] + curves.points[vertex + 1]


def _surroundings(doubled: NDArray[np.float32], share: float) -> NDArray[np.float32]:
    """A box (2, 3) that leaves out a share of values beyond each face, then made larger by its size
    on all sides: what is outside is far away from nearly all."""
    lowest, highest = np.quantile(doubled, [share, 1.0 - share], axis=0)
    size = (highest - lowest).max()
    return np.array([lowest - size, highest + size], np.float32)


def _planes(doubled: NDArray[np.float32], n_chunks: int, first: int) -> _Plane | int:
    if n_chunks == 1:
        return first
    n_below = n_chunks // 2
    axis = int(np.argmax(np.ptp(doubled, axis=0)))
    middle = len(doubled) * n_below // n_chunks
    order = np.argpartition(doubled[:, axis], middle)
    return _Plane(
        axis,
        doubled[order[middle], axis],
        _planes(doubled[order[:middle]], n_below, first),
        _planes(doubled[order[middle:]], n_chunks - n_below, first + n_below),
    )


def _assign(tree: _Plane | int, doubled: NDArray, which: NDArray, chunks: NDArray) -> None:
    """Write the chunk of the midpoints `which` of doubled (3, n)."""
    if isinstance(tree, int):
        chunks[which] = tree
        return
    below = doubled[tree.axis][which] < tree.value
    _assign(tree.below, doubled, which[below], chunks)
    _assign(tree.above, doubled, which[~below], chunks)


def top_lanes(n_chunks: int, stray: bool = False) -> list[list[tuple[int, int]]]:
    """The blocks over `n_chunks` chunks: of each the ranges [first, end) of chunks of its lanes.

    Block 0 holds them all; a lane of several chunks is a block further on, in the same order. There
    are none over a single chunk. A last chunk of stray segments has a lane beside all others, whose
    grid would be too coarse otherwise.
    """
    blocks: list[list[tuple[int, int]]] = []
    n_near = n_chunks - stray
    if stray and n_near:
        blocks.append([(0, n_near), (n_near, n_chunks)])
    todo = [(0, n_near)] if n_near > 1 else []
    for begin, end in todo:  # grows while it is walked through
        lanes = [(begin, end)]
        for _ in range(3):
            lanes = [part for lane in lanes for part in _halves(*lane)]
        blocks.append(lanes)
        todo += [lane for lane in lanes if lane[1] - lane[0] > 1]
    return blocks


def _halves(begin: int, end: int) -> list[tuple[int, int]]:
    middle = begin + (end - begin) // 2
    return [(begin, middle), (middle, end)] if end - begin > 1 else [(begin, end)]


def top_blocks(
    lanes: list[list[tuple[int, int]]],
    boxes: NDArray[np.float32],
    first_blocks: Sequence[int],
    stack_sizes: Sequence[int],
    first: int = 0,
) -> tuple[NDArray[np.uint32], int]:
    """Write the blocks over chunks.

    Parameters
    ----------
    lanes : list                        what top_lanes returns for n chunks
    boxes : (n, 2, 3) float64           corners of the chunks
    first_blocks : (n,)                 the root of each chunk
    stack_sizes : (n,)                  blocks that wait on the stack in a traversal of each
    first : int                         number of the first of them

    Returns
    -------
    blocks : (len(lanes), 32) uint32    see kernels/include/bvh/block.clh
    stack_size : int                    blocks that wait on it in one of the whole tree
    """
    place = {(block[0][0], block[-1][1]): i for i, block in enumerate(lanes)}
    blocks = np.zeros((len(lanes), BLOCK_WORDS), np.uint32)
    stacks = np.zeros(len(lanes), np.int64)
    for i in reversed(range(len(lanes))):
        children = lanes[i]
        lower = np.array([boxes[a:b, 0].min(axis=0) for a, b in children])
        upper = np.array([boxes[a:b, 1].max(axis=0) for a, b in children])
        _write_boxes(blocks[i], lower, upper)
        below = []
        for lane, (a, b) in enumerate(children):
            single = b - a == 1
            blocks[i, BLOCK_REFERENCES + lane] = first_blocks[a] if single else first + place[a, b]
            below.append(stack_sizes[a] if single else stacks[place[a, b]])
        stacks[i] = (len(children) > 1) + max(below)
    return blocks, int(stacks[0])


def _write_boxes(block, lower, upper) -> None:
    """Grid and faces of boxes (k, 3) float64, with room for rounding."""
    floats, rows = block.view(np.float32), block.view(np.uint8)
    grid_origin, grid_step = floats[BLOCK_ORIGIN:][:3], floats[BLOCK_STEP:][:3]
    n = len(lower)
    low, high = lower.min(axis=0), upper.max(axis=0)
    margin = (high - low) / 255.0 * (2.0 * GRID_MARGIN)
    grid_origin[:] = np.nextafter((low - margin).astype(np.float32), np.float32(-np.inf))
    origin = grid_origin.astype(np.float64)
    step = (high - origin) / (255.0 - 4.0 * GRID_MARGIN)
    grid_step[:] = np.maximum(np.nextafter(step.astype(np.float32), np.float32(np.inf)), 1e-30)
    step = grid_step.astype(np.float64)
    below = np.maximum(np.floor((lower - origin) / step - GRID_MARGIN), 0.0)
    above = np.minimum(np.ceil((upper - origin) / step + GRID_MARGIN), 255.0)
    for axis in range(3):
        rows[block_bytes(2 * axis)][:n] = below[:, axis]
        rows[block_bytes(2 * axis + 1)][:n] = above[:, axis]
    block[BLOCK_LANES] = (1 << n) - 1 | BLOCK_BOXES
