"""No fibre is hit again by the ray that leaves it, before it has really left it."""

from __future__ import annotations

import numpy as np
import pytest
from ray_reference import leaves_strand_before, strands, unit

from furcl.device.layout import NO_SEGMENT
from furcl.rendering.rays import Rays, Tracer


def straight(_):
    return strands(np.linspace([0, 0, 0], [1, 2, 3], 9)[None], 0.05, taper=0.5)


def kinked(degrees, step, n=20):
    def make(rng):
        directions = [unit(rng.standard_normal(3))]
        for _ in range(n - 2):
            across = unit(np.cross(directions[-1], rng.standard_normal(3)))
            turn = np.radians(degrees)
            directions.append(np.cos(turn) * directions[-1] + np.sin(turn) * across)
        points = np.concatenate([np.zeros((1, 3)), np.cumsum(step * np.array(directions), axis=0)])
        return strands(points[None], 0.05)

    return make


def curled(radius, pitch, turns, n=120):
    def make(_):
        t = np.linspace(0.0, 2.0 * np.pi * turns, n)
        points = [radius * np.cos(t), radius * np.sin(t), pitch * t / (2.0 * np.pi)]
        return strands(np.stack(points, axis=1)[None], 0.05)

    return make


STRANDS = {
    "straight": straight,
    "kinks of 30 degrees": kinked(30, 0.5),
    "kinks of 90 degrees": kinked(90, 0.5),
    "kinks of 150 degrees": kinked(150, 0.5),
    "kinks as short as thick": kinked(60, 0.06, 60),
    "curls": curled(0.5, 0.25, 6),
    "tight curls": curled(0.12, 0.15, 8),
}


def random_directions(rng, tangent):
    return unit(rng.standard_normal(tangent.shape))


def grazing_directions(rng, tangent):
    angle = 10.0 ** rng.uniform(-3.0, -0.5, (len(tangent), 1))
    across = unit(np.cross(tangent, rng.standard_normal(tangent.shape)))
    sign = rng.choice([-1.0, 1.0], (len(tangent), 1))
    return sign * np.cos(angle) * tangent + np.sin(angle) * across


DIRECTIONS = {"random": random_directions, "grazing": grazing_directions}


def leaving_rays(rng, curves, n, directions):
    """Origins on the axis, directions, segments and distances 4 r / sin(angle to the tangent)."""
    segment = rng.choice(curves.segment_vertices(), n)
    u = rng.random((n, 1)).astype(np.float32)
    a, b = curves.points[segment], curves.points[segment + 1]
    tangent = unit((b - a).astype(np.float64))
    d = directions(rng, tangent).astype(np.float32)
    radius = curves.radii[segment] * (1 - u[:, 0]) + curves.radii[segment + 1] * u[:, 0]
    sine = np.linalg.norm(np.cross(d, tangent), axis=1)
    origins = (a * (1 - u) + b * u).astype(np.float32)
    return origins, d, segment.astype(np.uint32), (4.0 * radius / sine).astype(np.float32)


def hits_again(device, curves, rays, t_max=np.inf):
    origins, d, segment, skip = rays
    tracer = Tracer(device, curves)
    on_device = Rays(tracer.memory, origins, d, t_max, segment, skip)
    tracer.closest(on_device)
    return tracer.hits(on_device)


@pytest.mark.parametrize("directions", DIRECTIONS)
@pytest.mark.parametrize("name", STRANDS)
def test_a_strand_is_hit_again_only_from_outside(device, name, directions, rng):
    curves = STRANDS[name](rng)
    rays = leaving_rays(rng, curves, 4000, DIRECTIONS[directions])
    t, segment, _ = hits_again(device, curves, rays)
    again = np.flatnonzero(segment != NO_SEGMENT)
    if name == "straight":
        assert not len(again)
    for i in again[:40]:
        assert leaves_strand_before(curves, rays[0][i], rays[1][i], t[i])
    if name == "curls" and directions == "random":
        assert len(again) > 200  # from outside, it is


@pytest.mark.parametrize("name", ["straight", "kinks of 30 degrees", "tight curls"])
def test_without_the_rule_it_would_be(device, name, rng):
    """The mutant twin: rays that say nothing of the fibre they leave hit it at once."""
    curves = STRANDS[name](rng)
    origins, d, segment, skip = leaving_rays(rng, curves, 4000, random_directions)
    nothing = np.full_like(segment, NO_SEGMENT)
    t, hit, _ = hits_again(device, curves, (origins, d, nothing, 0 * skip))
    inside = (hit != NO_SEGMENT) & (t < 0.25 * skip)
    assert inside.mean() > 0.05


def test_other_strands_are_hit_from_the_start(device, rng):
    """Of two strands that touch, a ray from one meets the other within the skipped distance."""
    points = np.array([[[0, 0, 0], [1, 0, 0]], [[0, 0.1, 0], [1, 0.1, 0]]], float)
    curves = strands(points, 0.05)
    n = 100
    origins = np.zeros((n, 3), np.float32)
    origins[:, 0] = rng.uniform(0.1, 0.9, n)
    d = np.tile(np.array([0, 1, 0], np.float32), (n, 1))
    rays = origins, d, np.zeros(n, np.uint32), np.full(n, 0.2, np.float32)
    t, segment, _ = hits_again(device, curves, rays)
    assert (segment == 2).all()
    assert np.allclose(t, 0.1)


def test_the_own_strand_is_hit_beyond_the_skipped_distance(device):
    """A hairpin: the way back is another part of the strand, three diameters away."""
    curves = strands(np.array([[[0, 0, 0], [1, 0, 0], [1, 0.3, 0], [0, 0.3, 0]]], float), 0.05)
    rays = (
        np.array([[0.2, 0, 0]], np.float32),
        np.array([[0, 1, 0]], np.float32),
        np.array([0], np.uint32),
        np.array([0.2], np.float32),
    )
    t, segment, _ = hits_again(device, curves, rays)
    assert segment[0] == 2
    assert t[0] == pytest.approx(0.3)
