"""The top of one tree over the subtrees of two: rays for nearest hits begin there beside meshes.

Both trees are opened where their boxes are largest, and what is below hangs from blocks of a tree
over these boxes. So what is near comes first, be it a fibre or a triangle, and ends the search. The
two trees stay whole, for rays that look for any hit.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import (
    BLOCK_BOXES,
    BLOCK_LANES,
    BLOCK_ORIGIN,
    BLOCK_REFERENCES,
    BLOCK_STEP,
    BVH_WIDTH,
    block_bytes,
)

#: Subtrees at most; more change little (docs/notebook.md).
SUBTREES = 1 << 10

Blocks = NDArray[np.uint32]
Read = Callable[[int, int], Blocks]
"""Blocks (n, 32) of a tree, of the first one and their number."""


@dataclass(frozen=True, eq=False)
class Subtree:
    """A part of a tree.

    Attributes
    ----------
    block : int             its root
    stack_size : int        blocks that wait on the stack in a traversal from there on, at most
    box : (2, 3) float64    lower and upper corner
    """

    block: int
    stack_size: int
    box: NDArray[np.float64]

    @property
    def half_area(self) -> float:
        """Half the surface of the box."""
        x, y, z = self.box[1] - self.box[0]
        return float(x * y + y * z + z * x)


def open_largest(read: Read, trees: Sequence[tuple[int, int]], n: int) -> list[Subtree]:
    """About `n` subtrees that hold all of some trees: those with the largest boxes are opened, as
    long as their lanes are subtrees in boxes. Empty if a root has capsules, which do not tell its
    box: it is a small tree.

    Parameters
    ----------
    read : callable         reads blocks of the trees
    trees : pairs           root and stack size of each
    """
    kept: list[Subtree] = []
    waiting: list[tuple[float, int, Subtree, Blocks]] = []

    def put(subtree: Subtree, block: Blocks) -> None:
        heapq.heappush(waiting, (-subtree.half_area, subtree.block, subtree, block))

    for root, stack_size in trees:
        block = read(root, 1)[0]
        boxes = lane_boxes(block)
        if boxes is None:
            return []
        put(Subtree(root, stack_size, np.stack([boxes[:, 0].min(0), boxes[:, 1].max(0)])), block)
    while waiting and len(waiting) + len(kept) < n:
        _, _, subtree, block = heapq.heappop(waiting)
        boxes = lane_boxes(block)
        if boxes is None or _leaves(block):
            kept.append(subtree)
            continue
        below = subtree.stack_size - (len(boxes) > 1)
        children = block[BLOCK_REFERENCES : BLOCK_REFERENCES + len(boxes)].astype(np.int64)
        for child, box, its_block in zip(children, boxes, _read_all(read, children), strict=True):
            put(Subtree(int(child), below, box), its_block)
    return kept + [subtree for _, _, subtree, _ in waiting]


def lane_boxes(block: Blocks) -> NDArray[np.float64] | None:
    """The boxes (lanes, 2, 3) of a block, as wide as on its grid; None of one of capsules."""
    kinds = int(block[BLOCK_LANES])
    if not kinds & BLOCK_BOXES:
        return None
    n = (kinds & 255).bit_count()
    rows = block.view(np.uint8)
    cells = np.stack([rows[block_bytes(row)][:n] for row in range(6)]).reshape(3, 2, n)
    origin, step = (
        block[place : place + 3].view(np.float32).astype(np.float64)[:, None, None]
        for place in (BLOCK_ORIGIN, BLOCK_STEP)
    )
    return (origin + step * cells).transpose(2, 1, 0)


def corners_of(subtrees: Sequence[Subtree]) -> NDArray[np.float32]:
    """Triangles (n, 3, 3) whose boxes hold those of subtrees, for the builder of trees."""
    boxes = np.array([subtree.box for subtree in subtrees])
    lower = np.nextafter(boxes[:, 0].astype(np.float32), np.float32(-np.inf))
    upper = np.nextafter(boxes[:, 1].astype(np.float32), np.float32(np.inf))
    return np.stack([lower, upper, lower], axis=1)


def hang(blocks: Blocks, first: int, subtrees: Sequence[Subtree]) -> int:
    """Make the leaves of a tree over `corners_of` the subtrees themselves, in place.

    Parameters
    ----------
    blocks : (b, 32)        the tree; children come after their parents
    first : int             number of its root, the first of them
    subtrees : sequence     triangle i stands for subtree i

    Returns
    -------
    int     blocks that wait on the stack in a traversal of all, at most
    """
    stack_sizes = np.zeros(len(blocks), np.int64)
    for i in reversed(range(len(blocks))):
        block = blocks[i]
        n, n_leaves = (int(block[BLOCK_LANES]) & 255).bit_count(), _leaves(block)
        references = block[BLOCK_REFERENCES : BLOCK_REFERENCES + n]
        hung = [subtrees[int(reference) // 3] for reference in references[:n_leaves]]
        below = [subtree.stack_size for subtree in hung]
        below += [int(stack_sizes[int(child) - first]) for child in references[n_leaves:]]
        references[:n_leaves] = [subtree.block for subtree in hung]
        block[BLOCK_LANES] = ((1 << n) - 1) | BLOCK_BOXES
        stack_sizes[i] = (n > 1) + max(below)
    return int(stack_sizes[0])


def _leaves(block: Blocks) -> int:
    """How many lanes are segments or triangles."""
    return (int(block[BLOCK_LANES]) >> BVH_WIDTH & 255).bit_count()


def _read_all(read: Read, numbers: NDArray[np.int64]) -> list[Blocks]:
    """The blocks of some numbers, those in a row at once."""
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1)
    return [block for run in runs for block in read(int(run[0]), len(run))]
