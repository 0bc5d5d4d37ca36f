"""A large groom cut into chunks of neighbours, and the top of the tree over them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from furcl.curves import Curves
from furcl.layout import BVH_BLOCK_WORDS

WIDTH = 8
BOXES = 1 << 16
GRID_MARGIN = 1.0 / 64.0  # as in kernels/include/bvh_block.clh


def split_segments(curves: Curves, n_chunks: int) -> Iterator[NDArray[np.uint32]]:
    """Cut the segments of a groom into chunks of nearly the same size.

    A set that makes k chunks is cut across the longest axis of its midpoints, so that one side
    makes k // 2 chunks; chunks are in the order of that tree, as `top_lanes` expects.

    Yields
    ------
    (n,) uint32     first vertices of the segments of a chunk
    """
    yield from _split(curves.points, curves.segment_vertices().view(np.uint32), n_chunks)


def _split(points, segments, n_chunks):
    if n_chunks == 1:
        yield segments
        return
    n_first = len(segments) * (n_chunks // 2) // n_chunks
    twice_middle = _longest_axis(points, segments)
    order = np.argpartition(twice_middle, n_first)
    del twice_middle
    segments[:] = segments[order]
    del order
    yield from _split(points, segments[:n_first], n_chunks // 2)
    yield from _split(points, segments[n_first:], n_chunks - n_chunks // 2)


def _longest_axis(points, segments):
    """Twice the coordinate of the midpoints along which they reach farthest, (n,)."""
    best, reach = np.empty(0, np.float32), -1.0
    for axis in range(3):
        x = points[:, axis]
        values = x[segments]
        values += x[segments + 1]
        extent = float(np.float64(values.max()) - values.min())
        if extent > reach:
            best, reach = values, extent
    return best


def top_lanes(n_chunks: int) -> list[list[tuple[int, int]]]:
    """The blocks over `n_chunks` chunks: of each the ranges [first, end) of chunks of its lanes.

    Block 0 holds them all; a lane of several chunks is a block further on, in the same order.
    """
    blocks, todo = [], [(0, n_chunks)]
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
    first_blocks: NDArray[np.uint32],
    stack_sizes: NDArray[np.integer],
) -> tuple[NDArray[np.uint32], int]:
    """Write the blocks over chunks.

    Parameters
    ----------
    lanes : list                        what top_lanes returns for n chunks
    boxes : (n, 2, 3) float32           corners of the chunks
    first_blocks : (n,) uint32          the root of each chunk
    stack_sizes : (n,) int              stack entries that a traversal of each can need

    Returns
    -------
    blocks : (len(lanes), 32) uint32    see kernels/include/bvh.clh
    stack_size : int                    stack entries that a traversal of the whole tree can need
    """
    place = {(block[0][0], block[-1][1]): i for i, block in enumerate(lanes)}
    blocks = np.zeros((len(lanes), BVH_BLOCK_WORDS), np.uint32)
    stacks = np.zeros(len(lanes), np.int64)
    for i in reversed(range(len(lanes))):
        children = lanes[i]
        lower = np.array([boxes[a:b, 0].min(axis=0) for a, b in children])
        upper = np.array([boxes[a:b, 1].max(axis=0) for a, b in children])
        _write_boxes(blocks[i], lower.astype(np.float64), upper.astype(np.float64))
        below = []
        for lane, (a, b) in enumerate(children):
            single = b - a == 1
            blocks[i, 24 + lane] = first_blocks[a] if single else place[a, b]
            below.append(stack_sizes[a] if single else stacks[place[a, b]])
        stacks[i] = len(children) - 1 + max(below)
    return blocks, int(stacks[0])


def _write_boxes(block, lower, upper) -> None:
    """Grid and faces of boxes (k, 3) float64, with room for rounding."""
    floats, rows = block.view(np.float32), block.view(np.uint8)
    low, high = lower.min(axis=0), upper.max(axis=0)
    margin = (high - low) / 255.0 * (2.0 * GRID_MARGIN)
    floats[:3] = np.nextafter((low - margin).astype(np.float32), np.float32(-np.inf))
    origin = floats[:3].astype(np.float64)
    step = (high - origin) / (255.0 - 4.0 * GRID_MARGIN)
    floats[4:7] = np.maximum(np.nextafter(step.astype(np.float32), np.float32(np.inf)), 1e-30)
    step = floats[4:7].astype(np.float64)
    for lane in range(len(lower)):
        rows[32 + lane : 80 : 16] = np.maximum(
            np.floor((lower[lane] - origin) / step - GRID_MARGIN), 0.0
        )
        rows[40 + lane : 80 : 16] = np.minimum(
            np.ceil((upper[lane] - origin) / step + GRID_MARGIN), 255.0
        )
    block[22] = (1 << len(lower)) - 1 | BOXES
