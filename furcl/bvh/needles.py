"""A few segments that are as long as all the rest: they are kept out of the rest's tree.

Embree's builder is greedy and weighs planes by the numbers of boxes beside them, so a box as large
as the groom stays with a part of it for several levels, and rays look into all these nodes. At the
top of the tree it costs a ray one block (docs/geometry.md).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.bvh import embree

#: At most so many are kept out: the root's block has lanes for them, and for the rest.
MOST_NEEDLES = 6
#: Of the size of the rest: what a needle is longer than, and all others are shorter than.
NEEDLE_SHARE, OTHERS_SHARE = 0.75, 0.25


def build_binary_tree(primitives: NDArray) -> embree.BinaryTree:
    """The tree of `furcl.bvh.embree.build_binary_tree`, whose first nodes have needles as children.

    Parameters
    ----------
    primitives : (n,) PRIMITIVE     boxes; reordered in place, needles last
    """
    n_needles = _needles_last(primitives)
    n = len(primitives)
    tree = embree.build_binary_tree(primitives[: n - n_needles])
    if n_needles == 0:
        return tree
    below = tree.nodes.copy()
    below[:, :2] += np.where(below[:, :2] >= 0, n_needles, 0)
    above = np.array([(i + 1, ~(n - 1 - i), 0, n - 1 - i) for i in range(n_needles)], np.int32)
    heights = tree.heights[0] + np.arange(n_needles, 0, -1)
    return embree.BinaryTree(
        np.concatenate([above, below]),
        np.concatenate([heights.astype(np.uint8), tree.heights]),
    )


def _needles_last(primitives: NDArray) -> int:
    """Move needles behind all others; returns how many there are."""
    n = len(primitives)
    if n < 4 * MOST_NEEDLES:
        return 0
    lower, upper = primitives["lower"], primitives["upper"]
    size = upper[:, 0] - lower[:, 0]
    for axis in (1, 2):
        np.maximum(size, upper[:, axis] - lower[:, axis], out=size)
    longest = np.argpartition(size, n - MOST_NEEDLES - 1)[n - MOST_NEEDLES - 1 :]
    longest = longest[np.argsort(size[longest], kind="stable")]
    if size[longest[-1]] * OTHERS_SHARE <= NEEDLE_SHARE * size[longest[0]]:
        return 0  # so in ordinary grooms
    others = np.ones(n, bool)
    others[longest[1:]] = False
    rest = (upper[others].max(axis=0) - lower[others].min(axis=0)).max()
    needles = longest[size[longest] > NEEDLE_SHARE * rest]
    if len(needles) == 0 or np.delete(size, needles).max() > OTHERS_SHARE * rest:
        return 0
    order = np.concatenate([np.delete(np.arange(n), needles), needles])
    primitives[:] = primitives[order]
    return len(needles)
