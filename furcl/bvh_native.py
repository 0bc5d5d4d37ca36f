"""Compiled: boxes around segments, and how a binary tree becomes one of 8-wide blocks."""

import numba
import numpy as np

WIDTH = 8


@numba.njit(cache=True, inline="always")
def float_below(x):
    """The largest float32 not above x, less one step."""
    return np.nextafter(np.float32(x), np.float32(-np.inf))


@numba.njit(cache=True, inline="always")
def float_above(x):
    return np.nextafter(np.float32(x), np.float32(np.inf))


@numba.njit(cache=True, parallel=True)
def segment_boxes(points, radii, vertices, lower, upper, number):
    """Boxes (n, 3) around segments `vertices` (n,) with radius and rounding; numbers (n,)."""
    for i in numba.prange(len(vertices)):
        v = vertices[i]
        number[i] = i
        for k in range(3):
            a, b = np.float64(points[v, k]), np.float64(points[v + 1, k])
            ra, rb = np.float64(radii[v]), np.float64(radii[v + 1])
            lower[i, k] = float_below(min(a - ra, b - rb))
            upper[i, k] = float_above(max(a + ra, b + rb))


@numba.njit(cache=True, inline="always")
def half_area(box_a, box_b):
    """Half the surface of the box around two boxes (2, 4)."""
    x = max(box_a[1, 0], box_b[1, 0]) - min(box_a[0, 0], box_b[0, 0])
    y = max(box_a[1, 1], box_b[1, 1]) - min(box_a[0, 1], box_b[0, 1])
    z = max(box_a[1, 2], box_b[1, 2]) - min(box_a[0, 2], box_b[0, 2])
    return x * y + y * z + z * x


@numba.njit(cache=True)
def choose_collapse(children, bounds):
    """How to make 8-wide blocks of a binary tree so that the sum of their surfaces is least.

    Dynamic programming over the ways to cover a subtree with at most i lanes (Ylitie et al. 2017,
    section 3.2; here a lane may be a single segment, and there are no leaf blocks).

    Parameters
    ----------
    children : (m, 2) int32, bounds : (m, 2, 2, 4) float32      as embree.build_binary_tree

    Returns
    -------
    choice : (m, 8) uint8       [node, 0] of eight lanes, how many the first side gets;
                                [node, i] of i lanes, how many the first side gets, 0: as for i - 1
    """
    m = len(children)
    choice = np.zeros((m, WIDTH), np.uint8)
    cost = np.zeros((m, WIDTH), np.float32)
    side = np.empty((2, WIDTH), np.float32)
    for node in range(m - 1, -1, -1):
        for k in range(2):
            child = children[node, k]
            if child < 0:
                side[k, :] = 0.0
            else:
                side[k, :] = cost[child]
        for i in range(WIDTH, 1, -1):
            best, split = np.float32(np.inf), 0
            for k in range(1, i):
                c = side[0, k] + side[1, i - k]
                if c < best:
                    best, split = c, k
            if i == WIDTH:
                cost[node, 1] = half_area(bounds[node, 0], bounds[node, 1]) + best
                choice[node, 0] = split
            else:
                cost[node, i] = best
                choice[node, i] = split
        for i in range(2, WIDTH):
            if cost[node, i - 1] <= cost[node, i]:
                cost[node, i] = cost[node, i - 1]
                choice[node, i] = 0
    return choice


@numba.njit(cache=True)
def plan_blocks(children, choice):
    """Lay out the blocks depth first, siblings side by side.

    A subtree is named by its edge, 2 * parent + side, in the binary tree.

    Returns
    -------
    lanes : (b, 8) int32        edge of each lane, -1: unused; segments come first
    refs : (b, 8) int32         child block, or for a lane that is one segment its complement
    stack_size : int            stack entries that the traversal can need
    """
    m = len(children)
    flat = children.ravel()
    lanes = np.full((m + 1, WIDTH), -1, np.int32)
    refs = np.zeros((m + 1, WIDTH), np.int32)
    nodes = np.empty(m + 1, np.int32)
    nodes[0] = 0
    n_blocks = 1
    todo = np.empty((4096, 2), np.int32)  # block, stack entries that it starts with
    todo[0] = 0, 0
    n_todo = 1
    stack_size = 0
    pending = np.empty((2 * WIDTH, 2), np.int64)
    while n_todo:
        n_todo -= 1
        block, depth = todo[n_todo]
        node = np.int64(nodes[block])
        split = np.int64(choice[node, 0])
        pending[0] = 2 * node, split
        pending[1] = 2 * node + 1, WIDTH - split
        n_pending = 2
        if flat[2 * node] == flat[2 * node + 1]:  # a groom of one segment
            n_pending = 1
        n_segments, n_subtrees = 0, 0
        while n_pending:
            n_pending -= 1
            e, i = pending[n_pending]
            child = np.int64(flat[e])
            while i > 1 and child >= 0 and choice[child, i] == 0:
                i -= 1
            if child < 0:
                lanes[block, n_segments + n_subtrees] = lanes[block, n_segments]
                lanes[block, n_segments] = e
                n_segments += 1
            elif i == 1:
                lanes[block, n_segments + n_subtrees] = e
                n_subtrees += 1
            else:
                k = np.int64(choice[child, i])
                pending[n_pending] = 2 * child, k
                pending[n_pending + 1] = 2 * child + 1, i - k
                n_pending += 2
        for i in range(n_segments):
            refs[block, i] = flat[lanes[block, i]]
        for i in range(n_segments, n_segments + n_subtrees):
            refs[block, i] = n_blocks
            nodes[n_blocks] = flat[lanes[block, i]]
            todo[n_todo] = n_blocks, depth + n_subtrees - 1
            n_todo += 1
            n_blocks += 1
        stack_size = max(stack_size, depth + n_subtrees - 1)
    return lanes[:n_blocks].copy(), refs[:n_blocks].copy(), stack_size
