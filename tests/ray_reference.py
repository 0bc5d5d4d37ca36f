"""Rays against ribbons in float64 numpy, every ray against every segment; and grooms to test on."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from furcl.device.layout import NO_SEGMENT
from furcl.groom.curves import Curves

CHUNK = 1 << 22  # ray-segment pairs at a time


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_directions(rng, n):
    return unit(rng.standard_normal((n, 3))).astype(np.float32)


def strands(points, radius, taper=0.0):
    """A groom of (S, k, 3) points; the radius falls linearly by `taper` towards the tip."""
    n, k, _ = points.shape
    radii = np.tile(radius * (1.0 - taper * np.linspace(0.0, 1.0, k)), n)
    return Curves.from_arrays(
        points.reshape(-1, 3).astype(np.float32),
        radii.astype(np.float32),
        np.arange(n + 1) * k,
    )


def random_walks(rng, n, k, step, radius, taper=0.0, turn=0.5):
    """Strands that start in the unit cube and turn at random."""
    direction = unit(rng.standard_normal((n, 3)))
    points = [rng.random((n, 3))]
    for _ in range(k - 1):
        direction = unit(direction + turn * rng.standard_normal((n, 3)))
        points.append(points[-1] + step * direction)
    return strands(np.stack(points, axis=1), radius, taper)


def nested(rng, orders, per_size=30, ratio=1.05):
    """Strands around the origin whose sizes and distances fill `orders` orders of magnitude."""
    n_sizes = int(orders * np.log(10.0) / np.log(ratio))
    size = np.repeat(10.0 ** (-orders / 2) * ratio ** np.arange(n_sizes), per_size)[:, None]
    middle, way = size * unit(rng.standard_normal((2, len(size), 3)))
    points = np.stack([middle - 0.1 * way, middle + 0.1 * way], axis=1).astype(np.float32)
    radii = np.repeat(1e-2 * size, 2).astype(np.float32)
    return Curves.from_arrays(points.reshape(-1, 3), radii, 2 * np.arange(len(size) + 1))


def rays_at(rng, curves, n):
    """Rays from around the groom at random places in it: origins and directions (n, 3) float32."""
    lo, hi = curves.bounds()
    size = np.linalg.norm(hi - lo)
    target = lo + rng.random((n, 3)) * (hi - lo)
    origins = (target - unit(rng.standard_normal((n, 3))) * size * rng.random((n, 1))).astype(
        np.float32
    )
    return origins, unit(target - origins).astype(np.float32)


def brute_force(curves, origins, directions, t_max=np.inf):
    """Nearest hits, and how surely they are what they are.

    Returns
    -------
    t, segment, u : (n,)
    margin : (n,)       the smallest change of (distance / radius) anywhere, or of t relative to the
                        distances at play, that would make another result; inf if there is none
    """
    first = curves.segment_vertices().astype(np.int64)
    a, b = curves.points[first].astype(np.float64), curves.points[first + 1].astype(np.float64)
    ra, rb = curves.radii[first].astype(np.float64), curves.radii[first + 1].astype(np.float64)
    n = len(origins)
    t_out, segment = np.full(n, np.inf), np.full(n, NO_SEGMENT, np.uint32)
    u_out, margin = np.zeros(n), np.full(n, np.inf)
    t_max = np.broadcast_to(np.asarray(t_max, np.float64), n)
    size = max(1, CHUNK // len(first))
    for start in range(0, n, size):
        rows = slice(start, start + size)
        o = origins[rows, None].astype(np.float64)
        d = unit(directions[rows, None].astype(np.float64))
        to_a, axis = a - o, b - a
        w = to_a - (to_a * d).sum(-1, keepdims=True) * d
        v = axis - (axis * d).sum(-1, keepdims=True) * d
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.clip(np.nan_to_num(-(w * v).sum(-1) / (v * v).sum(-1)), 0.0, 1.0)
        gap = np.linalg.norm(w + u[..., None] * v, axis=-1) / (ra + u * (rb - ra))
        t = ((to_a + u[..., None] * axis) * d).sum(-1)
        hit = (gap <= 1.0) & (t > 0.0) & (t <= t_max[rows, None])
        best = np.where(hit, t, np.inf)
        winner = best.argmin(axis=1)
        i = np.arange(len(winner))
        found = hit[i, winner]
        t_out[rows] = best[i, winner]
        segment[rows] = np.where(found, first[winner], NO_SEGMENT)
        u_out[rows] = np.where(found, u[i, winner], 0.0)
        # What else could be the nearest: anything up to there that is almost hit or just missed.
        scale = np.abs(to_a).max(-1) + 1e-30
        relevant = (t <= t_out[rows, None] * (1 + 1e-6) + 1e-6 * scale) & (t > -1e-6 * scale)
        doubt = np.where(relevant, np.abs(gap - 1.0), np.inf)
        doubt = np.minimum(doubt, np.where(gap <= 1.0 + 1e-3, np.abs(t) / scale, np.inf))
        margin[rows] = doubt.min(axis=1)
    return t_out, segment, u_out, margin


def sampled_stretch(curves, origin, direction, segment, u, t_max, per_radius=12):
    """Where a ray is inside its one-strand groom without having left it, by dense sampling.

    All pairs of a distance t along the ray and a place along the strand are marked at which the ray
    is within the radius of the strand; those joined to (0, segment and u) are inside still.

    Returns
    -------
    inside : callable (t, segment, u) -> bool
    """
    p, r = curves.points.astype(np.float64), curves.radii.astype(np.float64)
    step = r.min() / per_radius
    lengths = np.linalg.norm(np.diff(p, axis=0), axis=1)
    counts = np.maximum(np.ceil(lengths / step).astype(int), 1)
    first = np.concatenate([[0], np.cumsum(counts)])
    which = np.repeat(np.arange(len(counts)), counts)
    along = ((np.arange(first[-1]) - first[which]) / counts[which])[:, None]
    axis = np.concatenate([p[which] + along * (p[which + 1] - p[which]), p[-1:]])
    radius = np.append(r[which] + along[:, 0] * (r[which + 1] - r[which]), r[-1])
    t = np.arange(0.0, t_max + 2.0 * step, step)
    d = unit(direction.astype(np.float64))
    from_origin = axis - origin.astype(np.float64)
    # |o + t d - a|^2 <= r^2, written so that only one array is of the size of all pairs
    gap_sq = (from_origin**2).sum(-1) - radius**2
    inside = t[:, None] * (t[:, None] - 2.0 * (from_origin @ d)) <= -gap_sq
    joined = np.asarray(ndimage.label(inside)[0])  # pyright: ignore[reportIndexIssue]

    def label(distance, segment, u):
        row = min(round(distance / step), len(t) - 1)
        return joined[row, round(first[segment] + u * counts[segment])]

    begin = label(0.0, segment, u)
    return lambda t, segment, u: begin > 0 and label(t, segment, u) == begin
