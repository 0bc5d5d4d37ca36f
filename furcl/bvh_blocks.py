"""Compiled: writes the blocks of the tree, whose format is told in kernels/include/bvh.clh."""

import numba
import numpy as np

from furcl.bvh_native import WIDTH, float_above, float_below, half_area

GRID_MARGIN = 1.0 / 64.0  # room, in grid steps, between a box and its faces on the grid
CAPSULE_LIMIT = 512  # segments; lanes with more are bounded by boxes


@numba.njit(cache=True, inline="always")
def _set_grid(words, lower, upper):
    """Write origin and step of a grid that holds lower..upper (float64 (3,)) with the margin."""
    for k in range(3):
        margin = (upper[k] - lower[k]) / 255.0 * (2.0 * GRID_MARGIN)
        words[k] = float_below(lower[k] - margin)
        extent = upper[k] + margin - np.float64(words[k])
        words[4 + k] = max(float_above(extent / 255.0), np.float32(1e-30))


@numba.njit(cache=True)
def _segments_below(flat, edge, vertices, out):
    """Write the first vertices of the segments under an edge; returns how many, -1: too many."""
    pending = np.empty(160, np.int64)
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
                box_area += 2.0 * half_area(boxes[edge], boxes[edge])
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
    unit = float_above(wide[:n].max() / 254.0)
    floats[3] = unit
    for i in range(n):
        bytes_[80 + i] = np.uint8(np.ceil(wide[i] / np.float64(unit)))
