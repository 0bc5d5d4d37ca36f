"""Rays against triangles: beside float64, beside Embree, through closed meshes."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_shapes import nearest, soup, sphere
from ray_reference import random_walks, unit

from furcl.device.layout import NO_SEGMENT, TRIANGLE
from furcl.rendering.rays import Rays, Tracer


def far_groom():
    """A strand that no ray meets."""
    return random_walks(np.random.default_rng(0), 1, 2, 1e-3, 1e-6)


def trace(device, corners, origins, directions, t_max=np.inf, curves=None, from_segment=None):
    tracer = Tracer(device, curves or far_groom(), corners=corners)
    rays = Rays(tracer.memory, origins, directions, t_max, from_segment)
    tracer.closest(rays)
    t, name, _ = tracer.hits(rays)
    tracer.shadow(rays)
    assert np.array_equal(tracer.occluded(rays), name != NO_SEGMENT)
    return t, name


def triangle_of(name):
    """Numbers of triangles, -1 where there is none."""
    hit = (name >= TRIANGLE) & (name < NO_SEGMENT - 1)
    return np.where(hit, (name.astype(np.int64) - TRIANGLE) // 3, -1)


def rays_at(rng, corners, n):
    points = corners.reshape(-1, 3)
    lo, hi = points.min(axis=0), points.max(axis=0)
    target = lo + rng.random((n, 3)) * (hi - lo)
    origins = target - unit(rng.standard_normal((n, 3))) * np.linalg.norm(hi - lo) * rng.random(
        (n, 1)
    )
    return origins.astype(np.float32), unit(target - origins).astype(np.float32)


@pytest.mark.parametrize("n", [1, 2, 9, 700])
def test_hits_are_those_of_float64(device, n, rng):
    """Measured: no difference in 4000 rays beyond the margin."""
    corners = soup(rng, n).corners
    origins, d = rays_at(rng, corners, 4000)
    t, name = trace(device, corners, origins, d)
    expected_t, expected, margin = nearest(corners, origins, d)
    sure = margin > 1e-4
    assert sure.mean() > 0.5
    assert np.array_equal(triangle_of(name)[sure], expected[sure])
    both = sure & (expected >= 0)
    assert both.sum() > 20
    assert np.abs(t[both] / expected_t[both] - 1.0).max() < 1e-4


def through(rng, triangles, n):
    """Rays from inside a ball of radius 0.5 through its edges and corners, and at random."""
    c = triangles.corners
    which = rng.integers(0, len(c), n)
    share = rng.random((n, 1)).astype(np.float32)
    edge = c[which, 0] * share + c[which, 1] * (1 - share)
    goal = np.where((np.arange(n) % 3 == 0)[:, None], c[which, 2], edge)
    goal = np.where((np.arange(n) % 3 == 1)[:, None], rng.standard_normal((n, 3)), goal)
    origins = (0.3 * unit(rng.standard_normal((n, 3)))).astype(np.float32)
    return origins, unit(goal - origins).astype(np.float32)


@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_closed_meshes_leak_nothing(device, offset, rng):
    """A third of the rays aim at edges, a third at corners. 10^7 of each were tried by hand."""
    triangles = sphere(24)
    origins, d = through(rng, triangles, 300_000)
    corners = triangles.corners + np.float32(offset)
    _, name = trace(device, corners, origins + np.float32(offset), d)
    assert (name != NO_SEGMENT).all()
