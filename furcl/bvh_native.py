"""Compiled steps from a groom to the blocks of its tree: boxes, collapse to width 8, quantisation.

The format of a block is told in kernels/include/bvh.clh.
"""

import numba
import numpy as np

WIDTH = 8
GRID_MARGIN = 1.0 / 64.0  # room, in grid steps, between a box and its faces on the grid

CAPSULE_LIMIT = 512  # segments; larger subtrees are bounded by boxes


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
                cost[node, 1] = _half_area(bounds[node, 0], bounds[node, 1]) + best
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


@numba.njit(cache=True, inline="always")
def _set_grid(words, lower, upper):
    """Write origin and step of a grid that holds lower..upper (float64 (3,)) with the margin."""
    for k in range(3):
        margin = (upper[k] - lower[k]) / 255.0 * (2.0 * GRID_MARGIN)
        words[k] = _float_below(lower[k] - margin)
        extent = upper[k] + margin - np.float64(words[k])
        words[4 + k] = max(_float_above(extent / 255.0), np.float32(1e-30))


@numba.njit(cache=True)
def _segments_below(flat, edge, vertices, out):
    """Write the first vertices of the segments under an edge; returns how many, -1: too many."""
    pending = np.empty(128, np.int64)
    pending[0] = flat[edge]
    n_pending, n = 1, 0
    while n_pending:
        n_pending -= 1
        node = pending[n_pending]
        if node < 0:
            if n == len(out):
                return -1
            out[n] = vertices[~node]
            n += 1
        else:
            pending[n_pending] = flat[2 * node]
            pending[n_pending + 1] = flat[2 * node + 1]
            n_pending += 2
    return n


@numba.njit(cache=True)
def _fit_capsule(points, radii, segments, capsule):
    """A narrow capsule around segments: writes ends a, b and radius (7 float64)."""
    n = 2 * len(segments)
    mean, cov = np.zeros(3), np.zeros((3, 3))
    for s in segments:
        for v in range(s, s + 2):
            for k in range(3):
                mean[k] += points[v, k]
    mean /= n
    d = np.empty(3)
    for s in segments:
        for v in range(s, s + 2):
            for k in range(3):
                d[k] = points[v, k] - mean[k]
            for k in range(3):
                for j in range(3):
                    cov[k, j] += d[k] * d[j]
    # the longest axis by power iteration; it need not be exact
    axis = cov[np.argmax(np.array([cov[0, 0], cov[1, 1], cov[2, 2]]))].copy()
    for _ in range(6):
        size = np.abs(axis).max()
        if size <= 0.0:
            axis[:] = 1.0
            size = 1.0
        axis /= size
        axis = cov[0] * axis[0] + cov[1] * axis[1] + cov[2] * axis[2]
    size = np.sqrt((axis * axis).sum())
    if size > 0.0:
        axis /= size
    else:
        axis[:] = 0.0
        axis[0] = 1.0
    # centre of the cross-section: middle of its extents on three axes, kept across the axis
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for s in segments:
        for v in range(s, s + 2):
            z = 0.0
            for k in range(3):
                z += (points[v, k] - mean[k]) * axis[k]
            for k in range(3):
                w = points[v, k] - mean[k] - z * axis[k]
                low[k], high[k] = min(low[k], w), max(high[k], w)
    centre = (low + high) * 0.5
    z = (centre * axis).sum()
    for k in range(3):
        centre[k] += mean[k] - z * axis[k]
    radius = 0.0
    for s in segments:
        for v in range(s, s + 2):
            z, off_sq = 0.0, 0.0
            for k in range(3):
                d[k] = points[v, k] - centre[k]
                z += d[k] * axis[k]
            for k in range(3):
                w = d[k] - z * axis[k]
                off_sq += w * w
            radius = max(radius, np.sqrt(off_sq) + radii[v])
    radius *= 1.0 + 1e-9
    first, last = np.inf, -np.inf
    for s in segments:
        for v in range(s, s + 2):
            z, off_sq = 0.0, 0.0
            for k in range(3):
                d[k] = points[v, k] - centre[k]
                z += d[k] * axis[k]
            for k in range(3):
                w = d[k] - z * axis[k]
                off_sq += w * w
            room = radius - radii[v]
            reach = np.sqrt(max(0.0, room * room - off_sq))
            first, last = min(first, z + reach), max(last, z - reach)
    if first > last:
        first = last = 0.5 * (first + last)
    for k in range(3):
        capsule[k] = centre[k] + first * axis[k]
        capsule[3 + k] = centre[k] + last * axis[k]
    capsule[6] = radius


@numba.njit(cache=True, parallel=True)
def fill_blocks(blocks, lanes, refs, children, bounds, points, radii, vertices):
    """Write all blocks, (b, 32) uint32."""
    flat, boxes = children.ravel(), bounds.reshape(-1, 2, 4)
    for block in numba.prange(len(lanes)):
        words = blocks[block]
        capsules = np.empty((WIDTH, 7))
        segments = np.empty(CAPSULE_LIMIT, np.int64)
        n, n_segments, fits = 0, 0, True
        box_area, capsule_area = 0.0, 0.0
        while n < WIDTH and lanes[block, n] >= 0:
            edge = lanes[block, n]
            if refs[block, n] < 0:
                v = vertices[~refs[block, n]]
                for k in range(3):
                    capsules[n, k] = points[v, k]
                    capsules[n, 3 + k] = points[v + 1, k]
                capsules[n, 6] = 0.0
                words[24 + n] = v
                n_segments += 1
            else:
                words[24 + n] = refs[block, n]
                count = _segments_below(flat, edge, vertices, segments)
                if count < 0:
                    fits = False
                else:
                    _fit_capsule(points, radii, segments[:count], capsules[n])
                box_area += 2.0 * _half_area(boxes[edge], boxes[edge])
                r = capsules[n, 6]
                length_sq = 0.0
                for k in range(3):
                    length_sq += (capsules[n, 3 + k] - capsules[n, k]) ** 2
                capsule_area += 2.0 * np.pi * r * np.sqrt(length_sq) + 4.0 * np.pi * r * r
            n += 1
        words[22] = (1 << n) - 1 | ((1 << n_segments) - 1) << 8
        if n_segments > 0 and not fits:
            fits = True
            for i in range(n_segments, n):
                if _segments_below(flat, lanes[block, i], vertices, segments) < 0:
                    box = boxes[lanes[block, i]]
                    half_sq = 0.0
                    for k in range(3):
                        capsules[i, k] = 0.5 * (np.float64(box[0, k]) + box[1, k])
                        capsules[i, 3 + k] = capsules[i, k]
                        half_sq += (np.float64(box[1, k]) - capsules[i, k]) ** 2
                    capsules[i, 6] = np.sqrt(half_sq)
        if n_segments > 0 or (fits and capsule_area < box_area):
            _fill_capsules(words, capsules[:n], n_segments, points, radii)
        else:
            words[22] |= 1 << 16
            _fill_boxes(words, lanes[block, :n], boxes)


@numba.njit(cache=True)
def _fill_boxes(words, edges, boxes):
    """Write the grid and the faces of the children's boxes."""
    floats, bytes_ = words.view(np.float32), words.view(np.uint8)
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for edge in edges:
        for k in range(3):
            lower[k] = min(lower[k], boxes[edge, 0, k])
            upper[k] = max(upper[k], boxes[edge, 1, k])
    _set_grid(floats, lower, upper)
    for i in range(len(edges)):
        box = boxes[edges[i]]
        for k in range(3):
            origin, step = np.float64(floats[k]), np.float64(floats[4 + k])
            low = np.floor((box[0, k] - origin) / step - GRID_MARGIN)
            high = np.ceil((box[1, k] - origin) / step + GRID_MARGIN)
            bytes_[32 + 16 * k + i] = np.uint8(max(low, 0.0))
            bytes_[40 + 16 * k + i] = np.uint8(min(high, 255.0))


@numba.njit(cache=True)
def _fill_capsules(words, capsules, n_segments, points, radii):
    """Write grid capsules, each widened by how far the true one can be off it."""
    floats, bytes_ = words.view(np.float32), words.view(np.uint8)
    n = len(capsules)
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(n):
        for k in range(3):
            lower[k] = min(lower[k], min(capsules[i, k], capsules[i, 3 + k]))
            upper[k] = max(upper[k], max(capsules[i, k], capsules[i, 3 + k]))
    _set_grid(floats, lower, upper)
    wide = np.zeros(WIDTH)
    room = 0.0  # for the rounding of grid coordinates on the device
    for k in range(3):
        room += 1e-3 * np.float64(floats[4 + k])
    for i in range(n):
        for end in range(2):
            off_sq = 0.0
            for k in range(3):
                origin, step = np.float64(floats[k]), np.float64(floats[4 + k])
                x = capsules[i, 3 * end + k]
                q = min(max(np.rint((x - origin) / step), 0.0), 255.0)
                bytes_[32 + 16 * k + 8 * end + i] = np.uint8(q)
                off = x - (origin + q * step)
                off_sq += off * off
            r = radii[words[24 + i] + end] if i < n_segments else capsules[i, 6]
            wide[i] = max(wide[i], r + np.sqrt(off_sq) + room)
    unit = _float_above(wide[:n].max() / 254.0)
    floats[3] = unit
    for i in range(n):
        bytes_[80 + i] = np.uint8(np.ceil(wide[i] / np.float64(unit)))
