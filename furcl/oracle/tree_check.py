"""A whole tree checked against its groom, in float64 and without the code that built it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.bvh.build import BvhArrays
from furcl.device.layout import (
    BLOCK_BOXES,
    BLOCK_LANES,
    BLOCK_ORIGIN,
    BLOCK_REFERENCES,
    BLOCK_STEP,
    BLOCK_UNIT,
    BLOCK_WORDS,
    BVH_WIDTH,
    ROW_RADIUS,
    block_bytes,
)
from furcl.errors import BvhError
from furcl.groom.curves import Curves


def check_bvh(bvh: BvhArrays, curves: Curves) -> None:
    """Check that every segment is in the tree once and inside the bounds of all lanes above it.

    Raises
    ------
    BvhError    naming the first block, lane or segment that is wrong
    """
    _check_copies(bvh, curves)
    used, is_segment, is_boxes, references = _lanes(bvh.blocks)
    parent, parent_lane = _parents(used & ~is_segment, references)
    block, lane = np.nonzero(is_segment)
    _check_segments(references[block, lane], curves)
    segment = references[block, lane].astype(np.int64)
    while len(block):
        _check_inside(bvh.blocks, is_boxes, block, lane, segment, curves)
        below = block > 0
        segment = segment[below]
        block, lane = parent[block[below]], parent_lane[block[below]]
    _check_stack(bvh, (used & ~is_segment).sum(axis=1), parent)


def _check_copies(bvh: BvhArrays, curves: Curves) -> None:
    if bvh.blocks.ndim != 2 or bvh.blocks.shape[1] != BLOCK_WORDS or not len(bvh.blocks):
        raise BvhError(f"blocks have shape {bvh.blocks.shape}; expected (b, {BLOCK_WORDS})")
    vertices = np.concatenate([curves.points, curves.radii[:, None]], axis=1)
    if not np.array_equal(bvh.vertices, vertices):
        raise BvhError("the vertices of the tree are not those of the groom")
    if not np.array_equal(bvh.offsets, curves.offsets):
        raise BvhError("the strand offsets of the tree are not those of the groom")


def _lanes(blocks: NDArray[np.uint32]):
    """Masks (b, 8) of lanes in use and of segments, mask (b,) of boxes, references (b, 8)."""
    kinds, bit = blocks[:, BLOCK_LANES], np.arange(BVH_WIDTH)
    used = (kinds[:, None] >> bit & 1).astype(bool)
    is_segment = (kinds[:, None] >> (BVH_WIDTH + bit) & 1).astype(bool)
    is_boxes = (kinds & BLOCK_BOXES) != 0
    steps = blocks.view(np.float32)[:, BLOCK_STEP : BLOCK_STEP + 3]
    for name, wrong in (
        ("no lane is in use", ~used.any(axis=1)),
        ("a lane that is not in use is a segment", (is_segment & ~used).any(axis=1)),
        ("a segment is bounded by a box", is_boxes & is_segment.any(axis=1)),
        ("an unknown flag is set", kinds >= 2 * BLOCK_BOXES),
        ("the steps of a grid of capsules differ", ~is_boxes & (np.ptp(steps, axis=1) != 0.0)),
    ):
        if wrong.any():
            raise BvhError(f"block {int(np.argmax(wrong))}: {name}")
    return used, is_segment, is_boxes, blocks[:, BLOCK_REFERENCES:]


def _parents(is_subtree: NDArray[np.bool_], references: NDArray[np.uint32]):
    """The block and the lane that each block hangs from; every block but the root from one."""
    n = len(references)
    block, lane = np.nonzero(is_subtree)
    child = references[block, lane].astype(np.int64)
    wrong = (child >= n) | (child <= block)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise BvhError(
            f"block {block[i]}, lane {lane[i]}: child {child[i]} of {n} blocks; a child follows "
            "its parent"
        )
    times = np.bincount(child, minlength=n)
    wrong = times != (np.arange(n) > 0)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise BvhError(f"block {i} is the child of {times[i]} lanes; expected {int(i > 0)}")
    parent, parent_lane = np.zeros(n, np.int64), np.zeros(n, np.int64)
    parent[child], parent_lane[child] = block, lane
    return parent, parent_lane


def _check_segments(found: NDArray[np.uint32], curves: Curves) -> None:
    times = np.bincount(found, minlength=curves.n_points)
    expected = np.zeros(len(times), np.int64)
    expected[curves.segment_vertices()] = 1
    wrong = times != expected
    if wrong.any():
        i = int(np.argmax(wrong))
        raise BvhError(f"segment {i} is in {times[i]} lanes; expected {expected[i]}")


def _check_inside(blocks, is_boxes, block, lane, segment, curves: Curves) -> None:
    """Every segment lies, with its radius, inside the bounds of its (block, lane)."""
    floats, rows = blocks.view(np.float32), blocks.view(np.uint8)
    origin = floats[block, BLOCK_ORIGIN : BLOCK_ORIGIN + 3].astype(np.float64)
    step = floats[block, BLOCK_STEP : BLOCK_STEP + 3].astype(np.float64)
    ends = np.empty((2, len(block), 3))  # of a capsule's axis, or lower and upper faces of a box
    for i in range(2):
        for k in range(3):
            cell = rows[block, block_bytes(2 * k + i).start + lane]
            ends[i, :, k] = origin[:, k] + step[:, k] * cell
    radius = floats[block, BLOCK_UNIT].astype(np.float64)
    radius = radius * rows[block, block_bytes(ROW_RADIUS).start + lane]
    boxes = is_boxes[block]
    for vertex in (segment, segment + 1):
        p = curves.points[vertex].astype(np.float64)
        r = curves.radii[vertex].astype(np.float64)
        in_box = ((ends[0] <= p - r[:, None]) & (p + r[:, None] <= ends[1])).all(axis=1)
        in_capsule = _distance(p, ends[0], ends[1]) + r <= radius
        wrong = ~np.where(boxes, in_box, in_capsule)
        if wrong.any():
            i = int(np.argmax(wrong))
            raise BvhError(
                f"block {block[i]}, lane {lane[i]}: vertex {vertex[i]} sticks out of the bounds"
            )


def _distance(p, a, b):
    """Distance of points from the lines from a to b, all (n, 3)."""
    axis = b - a
    length_sq = (axis * axis).sum(axis=1)
    along = ((p - a) * axis).sum(axis=1)
    u = np.clip(along / np.where(length_sq > 0, length_sq, 1.0), 0.0, 1.0)
    return np.sqrt(((p - a - u[:, None] * axis) ** 2).sum(axis=1))


def _check_stack(bvh: BvhArrays, n_subtrees, parent) -> None:
    """The stack holds the blocks of which lanes wait on the way to any block."""
    waits = (n_subtrees > 1).astype(np.int64)
    total = waits.copy()
    block = np.arange(len(parent))
    while block.any():
        total += np.where(block > 0, waits[parent[block]], 0)
        block = parent[block]
    needed = int(total.max())
    if needed != bvh.stack_size:
        raise BvhError(f"{needed} blocks wait on a stack, the tree says {bvh.stack_size}")
