"""Meshes that tests are made on, and rays against them in float64."""

from __future__ import annotations

import numpy as np

from furcl.surface.mesh.triangles import Triangles

CHUNK = 1 << 21  # ray-triangle pairs at a time


def sphere(n=24, radius=1.0, centre=(0.0, 0.0, 0.0), **options):
    """A closed ball of latitudes and longitudes: thin triangles at the poles."""
    theta = np.linspace(0.0, np.pi, n + 1)[1:-1]
    phi = np.arange(2 * n) * np.pi / n
    ring = np.stack(
        [
            np.sin(theta)[:, None] * np.cos(phi),
            np.sin(theta)[:, None] * np.sin(phi),
            np.broadcast_to(np.cos(theta)[:, None], (n - 1, 2 * n)),
        ],
        axis=2,
    ).reshape(-1, 3)
    points = np.concatenate([ring, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    top, bottom = len(points) - 2, len(points) - 1
    i, j = np.meshgrid(np.arange(n - 2), np.arange(2 * n), indexing="ij")
    a, b = i * 2 * n + j, i * 2 * n + (j + 1) % (2 * n)
    quads = np.stack([a, a + 2 * n, b + 2 * n, b], axis=2).reshape(-1, 4)
    j = np.arange(2 * n)
    last = (n - 2) * 2 * n
    faces = np.concatenate(
        [
            quads[:, [0, 1, 2]],
            quads[:, [0, 2, 3]],
            np.stack([np.full_like(j, top), j, (j + 1) % (2 * n)], axis=1),
            np.stack([np.full_like(j, bottom), last + (j + 1) % (2 * n), last + j], axis=1),
        ]
    )
    return Triangles.from_arrays(radius * points + np.asarray(centre), faces, **options)


def box(lower, upper):
    """Corners (12, 3, 3) of a box."""
    faces = [
        [0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5],
    ]  # fmt: skip
    points = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float64)
    points = np.asarray(lower) + points * (np.asarray(upper) - np.asarray(lower))
    halves = [half for a, b, c, d in faces for half in ([a, b, c], [a, c, d])]
    return Triangles.from_arrays(points, halves).corners


def soup(rng, n, size=0.2):
    """Triangles without any order, of very different sizes."""
    centre = rng.random((n, 1, 3))
    scale = size * 10.0 ** rng.uniform(-2.0, 0.0, (n, 1, 1))
    corners = centre + scale * rng.standard_normal((n, 3, 3))
    return Triangles.from_arrays(corners.reshape(-1, 3), np.arange(3 * n).reshape(n, 3))


def nearest(corners, origins, directions, t_max=np.inf):
    """Nearest hits in float64 by the usual determinants, every ray on every triangle.

    Returns
    -------
    t : (n,) float64        inf where nothing is hit
    triangle : (n,) int     -1 where nothing is hit
    margin : (n,)           the smallest of all weights' distances from 0: what rounding could turn
    """
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    n = len(origins)
    out_t, out_triangle, margin = np.full(n, np.inf), np.full(n, -1), np.full(n, np.inf)
    rows = max(1, CHUNK // len(a))
    for start in range(0, n, rows):
        part = slice(start, start + rows)
        o = origins[part, None].astype(np.float64)
        d = directions[part, None].astype(np.float64)
        p = np.cross(d, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / ((b - a) * p).sum(axis=2)
            u = ((o - a) * p).sum(axis=2) * inverse
            q = np.cross(o - a, b - a)
            v = (d * q).sum(axis=2) * inverse
            t = ((c - a) * q).sum(axis=2) * inverse
            weight = np.minimum(np.minimum(u, v), 1.0 - u - v)
        weight = np.nan_to_num(weight, nan=-1.0)
        hit = (weight >= 0.0) & (t > 0.0) & (t <= t_max)
        t = np.where(hit, t, np.inf)
        first = t.argmin(axis=1)
        at = np.arange(len(first))
        found = hit[at, first]
        out_t[part] = np.where(found, t[at, first], np.inf)
        out_triangle[part] = np.where(found, first, -1)
        margin[part] = np.abs(weight).min(axis=1)
    return out_t, out_triangle, margin
