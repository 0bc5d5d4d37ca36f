"""Compiled steps from a groom to the blocks of its tree: boxes, collapse to width 8, quantisation.

The format of a block is told in kernels/include/bvh.clh.
"""

import numba
import numpy as np

WIDTH = 8
GRID_MARGIN = 1.0 / 64.0  # room, in grid steps, between a box and its faces on the grid

# Cost of a block relative to each other, by measurement (docs/performance.md).
INNER_COST = 1.0
LEAF_COST = 1.0
SEGMENT_COST = 0.1
LEAF_CHOICE = 255


@numba.njit(cache=True, inline="always")
def _float_below(x):
    """The largest float32 not above x, less one step."""
    return np.nextafter(np.float32(x), np.float32(-np.inf))


@numba.njit(cache=True, inline="always")
def _float_above(x):
    return np.nextafter(np.float32(x), np.float32(np.inf))


@numba.njit(cache=True, parallel=True)
def segment_boxes(points, radii, vertices, lower, upper, number):
    """Boxes (n, 3) around segments `vertices` (n,), radius and rounding included, and numbers (n,)."""
    for i in numba.prange(len(vertices)):
        v = vertices[i]
        number[i] = i
        for k in range(3):
            a, b = np.float64(points[v, k]), np.float64(points[v + 1, k])
            ra, rb = np.float64(radii[v]), np.float64(radii[v + 1])
            lower[i, k] = _float_below(min(a - ra, b - rb))
            upper[i, k] = _float_above(max(a + ra, b + rb))


@numba.njit(cache=True, inline="always")
def _half_area(box_a, box_b):
    """Half the surface of the box around two boxes (2, 4)."""
    x = max(box_a[1, 0], box_b[1, 0]) - min(box_a[0, 0], box_b[0, 0])
    y = max(box_a[1, 1], box_b[1, 1]) - min(box_a[0, 1], box_b[0, 1])
    z = max(box_a[1, 2], box_b[1, 2]) - min(box_a[0, 2], box_b[0, 2])
    return x * y + y * z + z * x


@numba.njit(cache=True)
def choose_collapse(children, bounds):
    """How to make 8-wide blocks of a binary tree so that a ray's expected cost is least.

    Dynamic programming over the ways to cover a subtree with at most i blocks (Ylitie et al. 2017,
    section 3.2), with a cost per leaf block that hardly depends on how full it is.

    Parameters
    ----------
    children : (m, 2) int32, bounds : (m, 2, 2, 4) float32      as embree.build_binary_tree

    Returns
    -------
    choice : (m, 8) uint8       [node, 0] of eight children, how many the first side gets;
                                [node, 1] LEAF_CHOICE: one leaf block, 0: one inner block;
                                [node, i] how many of i the first side gets, 0: as for i - 1
    """
    m = len(children)
    choice = np.zeros((m, WIDTH), np.uint8)
    cost = np.empty((m, WIDTH), np.float32)
    count = np.empty(m, np.int32)
    side = np.empty((2, WIDTH), np.float32)
    for node in range(m - 1, -1, -1):
        n = 0
        for k in range(2):
            child = children[node, k]
            if child < 0:
                n += 1
                area = _half_area(bounds[node, k], bounds[node, k])
                side[k, :] = area * np.float32(LEAF_COST + SEGMENT_COST)
            else:
                n += count[child]
                side[k, :] = cost[child]
        count[node] = n
        for i in range(WIDTH, 1, -1):
            best, split = np.float32(np.inf), 0
            for k in range(1, i):
                c = side[0, k] + side[1, i - k]
                if c < best:
                    best, split = c, k
            if i == WIDTH:
                area = _half_area(bounds[node, 0], bounds[node, 1])
                cost[node, 1] = area * np.float32(INNER_COST) + best
                choice[node, 0] = split
                if n <= WIDTH:
                    leaf = area * np.float32(LEAF_COST + SEGMENT_COST * n)
                    if leaf <= cost[node, 1]:
                        cost[node, 1] = leaf
                        choice[node, 1] = LEAF_CHOICE
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
    """Lay out the blocks: siblings side by side, subtrees depth first.

    A subtree is named by its edge, 2 * parent + side, in the binary tree; -1 is the root.

    Returns
    -------
    edges : (b,) int64          the subtree of each block
    first : (b,) int32          first child block of an inner block; -1 for a leaf
    width : (b,) int32          number of children, or of segments
    stack_size : int            stack entries that the traversal can need
    """
    m = len(children)
    edges = np.empty(2 * m + 2, np.int64)
    first = np.empty(2 * m + 2, np.int32)
    width = np.empty(2 * m + 2, np.int32)
    flat = children.ravel()
    edges[0] = -1
    n_blocks = 1
    todo = np.empty((16 * 256, 2), np.int32)  # block, stack entries that it starts with
    todo[0] = 0, 0
    n_todo = 1
    stack_size = 0
    pending = np.empty((2 * WIDTH, 2), np.int64)
    while n_todo:
        n_todo -= 1
        block, depth = todo[n_todo]
        edge = edges[block]
        node = np.int64(0) if edge < 0 else np.int64(flat[edge])
        is_leaf = edge >= 0 and (node < 0 or choice[node, 1] == LEAF_CHOICE)
        if is_leaf:
            first[block] = -1
            width[block] = 0
            continue
        first[block] = n_blocks
        n_pending = 2
        split = np.int64(choice[node, 0])
        pending[0] = 2 * node, split
        pending[1] = 2 * node + 1, WIDTH - split
        if flat[2 * node] == flat[2 * node + 1]:  # a groom of one segment
            n_pending = 1
        while n_pending:
            n_pending -= 1
            e, i = pending[n_pending]
            child = flat[e]
            while i > 1 and child >= 0 and choice[child, i] == 0:
                i -= 1
            if child < 0 or i == 1:
                edges[n_blocks] = e
                n_blocks += 1
            else:
                k = np.int64(choice[child, i])
                pending[n_pending] = 2 * child, k
                pending[n_pending + 1] = 2 * child + 1, i - k
                n_pending += 2
        n = n_blocks - first[block]
        width[block] = n
        for i in range(n - 1, -1, -1):
            todo[n_todo] = first[block] + i, depth + n - 1
            n_todo += 1
        stack_size = max(stack_size, depth + n - 1)
    return edges[:n_blocks].copy(), first[:n_blocks].copy(), width[:n_blocks].copy(), stack_size


@numba.njit(cache=True, inline="always")
def _set_grid(words, lower, upper):
    """Write origin and step of a grid that holds lower..upper with the margin; float64 (3,) each."""
    for k in range(3):
        margin = (upper[k] - lower[k]) / 255.0 * (2.0 * GRID_MARGIN)
        words[k] = _float_below(lower[k] - margin)
        extent = upper[k] + margin - np.float64(words[k])
        words[4 + k] = max(_float_above(extent / 255.0), np.float32(1e-30))


@numba.njit(cache=True, parallel=True)
def fill_inner(bytes_, words, floats, edges, first, width, bounds):
    """Write the inner blocks. bytes_ (b, 128) uint8, words (b, 32) uint32, floats: the same memory."""
    boxes = bounds.reshape(-1, 2, 4)
    for block in numba.prange(len(edges)):
        if first[block] < 0:
            continue
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for i in range(width[block]):
            box = boxes[edges[first[block] + i]]
            for k in range(3):
                lower[k] = min(lower[k], box[0, k])
                upper[k] = max(upper[k], box[1, k])
        _set_grid(floats[block], lower, upper)
        words[block, 7] = first[block]
        leaves = 0
        for i in range(width[block]):
            child = first[block] + i
            if first[child] < 0:
                leaves |= 1 << i
            box = boxes[edges[child]]
            for k in range(3):
                origin, step = np.float64(floats[block, k]), np.float64(floats[block, 4 + k])
                low = np.floor((box[0, k] - origin) / step - GRID_MARGIN)
                high = np.ceil((box[1, k] - origin) / step + GRID_MARGIN)
                bytes_[block, 32 + 16 * k + i] = max(low, 0.0)
                bytes_[block, 40 + 16 * k + i] = min(high, 255.0)
        words[block, 22] = (1 << width[block]) - 1 | leaves << 8


@numba.njit(cache=True, parallel=True)
def fill_leaves(bytes_, words, floats, edges, first, children, points, radii, vertices):
    """Write the leaf blocks: grid segments, each widened by how far the true one can be off it."""
    flat = children.ravel()
    for block in numba.prange(len(edges)):
        if first[block] >= 0:
            continue
        segments = np.empty(WIDTH, np.int64)
        pending = np.empty(2 * WIDTH, np.int64)
        pending[0] = flat[edges[block]]
        n_pending, n = 1, 0
        while n_pending:
            n_pending -= 1
            node = pending[n_pending]
            if node < 0:
                segments[n] = vertices[~node]
                n += 1
            else:
                pending[n_pending] = flat[2 * node]
                pending[n_pending + 1] = flat[2 * node + 1]
                n_pending += 2
        segments[:n].sort()
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for i in range(n):
            for k in range(3):
                a, b = points[segments[i], k], points[segments[i] + 1, k]
                lower[k] = min(lower[k], min(a, b))
                upper[k] = max(upper[k], max(a, b))
        _set_grid(floats[block], lower, upper)
        wide = np.empty(WIDTH, np.float64)
        room = 0.0  # for the rounding of grid coordinates on the device
        for k in range(3):
            room += 1e-3 * np.float64(floats[block, 4 + k])
        for i in range(n):
            wide[i] = 0.0
            for end in range(2):
                off_sq = 0.0
                for k in range(3):
                    origin, step = np.float64(floats[block, k]), np.float64(floats[block, 4 + k])
                    x = np.float64(points[segments[i] + end, k])
                    q = min(max(np.rint((x - origin) / step), 0.0), 255.0)
                    bytes_[block, 32 + 16 * k + 8 * end + i] = np.uint8(q)
                    off = x - (origin + q * step)
                    off_sq += off * off
                wide[i] = max(wide[i], radii[segments[i] + end] + np.sqrt(off_sq) + room)
        unit = _float_above(wide[:n].max() / 254.0)
        floats[block, 3] = unit
        for i in range(n):
            bytes_[block, 80 + i] = np.uint8(np.ceil(wide[i] / np.float64(unit)))
            words[block, 24 + i] = segments[i]
        words[block, 22] = (1 << n) - 1
