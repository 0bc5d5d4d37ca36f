"""A ray from a fibre hits what it comes to from outside, and nothing that it begins inside."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from ray_reference import sampled_stretch, strands, unit

from furcl.bench.ray_counts import count_rays
from furcl.device import source
from furcl.device.layout import NO_SEGMENT
from furcl.groom.curves import Curves
from furcl.oracle.host_render import Segments
from furcl.rendering.rays import Rays, Tracer

RADIUS = 0.05


def straight(_):
    return strands(np.linspace([0, 0, 0], [1, 2, 3], 9)[None], RADIUS, taper=0.5)


def kinked(degrees, step, n=20):
    def make(rng):
        directions = [unit(rng.standard_normal(3))]
        for _ in range(n - 2):
            across = unit(np.cross(directions[-1], rng.standard_normal(3)))
            turn = np.radians(degrees)
            directions.append(np.cos(turn) * directions[-1] + np.sin(turn) * across)
        points = np.concatenate([np.zeros((1, 3)), np.cumsum(step * np.array(directions), axis=0)])
        return strands(points[None], RADIUS)

    return make


def curled(radius, pitch, turns, n=120):
    def make(_):
        t = np.linspace(0.0, 2.0 * np.pi * turns, n)
        points = [radius * np.cos(t), radius * np.sin(t), pitch * t / (2.0 * np.pi)]
        return strands(np.stack(points, axis=1)[None], RADIUS)

    return make


def returning(apart):
    """Two arms, `apart` radii from each other, joined by half a circle."""

    def make(_):
        r = 0.5 * apart * RADIUS
        angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 12)
        bend = [1.0 + r * np.cos(angle), r * np.sin(angle), 0.0 * angle]
        arms = [[[x, y, 0.0] for x in (0.0, 0.5)] for y in (-r, r)]
        points = np.concatenate([arms[0], np.stack(bend, axis=1), arms[1][::-1]])
        return strands(points[None], RADIUS)

    return make


STRANDS = {
    "straight": straight,
    "kinks of 30 degrees": kinked(30, 0.5),
    "kinks of 90 degrees": kinked(90, 0.5),
    "kinks of 150 degrees": kinked(150, 0.5),
    "kinks as short as thick": kinked(60, 0.06, 60),
    "points much closer than thick": kinked(10, 0.002, 200),
    "curls": curled(0.5, 0.25, 6),
    "tight curls": curled(0.12, 0.15, 8),
    "coils that touch": curled(0.5, 2.05 * RADIUS, 4, 200),
    "a return beside itself": returning(2.05),
    "a return into itself": returning(1.5),
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
    """Origins on the axis, directions, segments and places u on them."""
    segment = rng.choice(curves.segment_vertices(), n)
    u = rng.random((n, 1)).astype(np.float32)
    a, b = curves.points[segment], curves.points[segment + 1]
    d = directions(rng, unit((b - a).astype(np.float64))).astype(np.float32)
    return (a * (1 - u) + b * u).astype(np.float32), d, segment.astype(np.uint32), u[:, 0]


def hits_again(device, curves, origins, d, segment):
    tracer = Tracer(device, curves)
    rays = Rays(tracer.memory, origins, d, np.inf, segment)
    tracer.closest(rays)
    return tracer.hits(rays)


@pytest.mark.parametrize("directions", DIRECTIONS)
@pytest.mark.parametrize("name", STRANDS)
def test_hits_are_those_from_outside(device, name, directions, rng):
    """Against float64, every ray tried on every segment."""
    curves = STRANDS[name](rng)
    origins, d, segment, _ = leaving_rays(rng, curves, 4000, DIRECTIONS[directions])
    t, found, _ = hits_again(device, curves, origins, d, segment)
    d64 = unit(d.astype(np.float64))
    expected_t, expected, _ = Segments(curves).closest(
        origins.astype(np.float64), d64, segment.astype(np.int64)
    )
    same = found == np.where(expected < 0, NO_SEGMENT, expected)
    both = (found != NO_SEGMENT) & (expected >= 0)
    same[both] |= np.abs(t[both] - expected_t[both]) < 1e-4 * RADIUS
    assert same.mean() > 0.998  # where a ray just meets a ball or just misses it
    if name == "straight":
        assert (found == NO_SEGMENT).all()
    if name in ("curls", "coils that touch", "a return beside itself") and directions == "random":
        assert (found != NO_SEGMENT).mean() > 0.05  # from outside, it is


@pytest.mark.parametrize("directions", DIRECTIONS)
@pytest.mark.parametrize("name", STRANDS)
def test_inside_is_what_is_joined_to_the_origin(name, directions, rng):
    """The rule of balls, which the float64 rays above follow, against sampling of all pairs of a
    place on the ray and a place on the strand."""
    curves = STRANDS[name](rng)
    segments = Segments(curves)
    origins, d, segment, u = leaving_rays(rng, curves, 24, DIRECTIONS[directions])
    at = segment.astype(np.int64)
    t, hit, place = segments.closest(origins.astype(np.float64), unit(d.astype(np.float64)), at)
    nothing = np.full_like(at, -1)
    t_any, any_hit, place_any = segments.closest(
        origins.astype(np.float64), unit(d.astype(np.float64)), nothing
    )
    wrong = 0
    for i in range(len(at)):
        reach = t[i] if hit[i] >= 0 else min(t_any[i], 1.0)
        inside = sampled_stretch(curves, origins[i], d[i], at[i], u[i], reach)
        if hit[i] >= 0:
            wrong += inside(t[i], hit[i], place[i])
        if any_hit[i] >= 0 and t_any[i] < reach:  # what the rule leaves out
            wrong += not inside(t_any[i], any_hit[i], place_any[i])
    assert wrong <= 1  # a neck narrower than the samples are apart


MUTANTS = {
    "nothing is left": (
        "if (first >= FURCL_TRIANGLE) return", "return",
        ["straight", "tight curls"],
    ),
    "the own segment alone is left": (
        "return (uint2)(first, last - first);", "return (uint2)(query->from_segment, 0u);",
        ["straight", "kinks as short as thick"],
    ),
    "the whole strand is left": (
        "meets_ball(query, vertex_at_time(groom->vertices, last + 1u, time)) && ", "",
        ["curls", "a return beside itself"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("mutant", MUTANTS)
def test_mutants_are_seen(device, mutant, rng, tmp_path, monkeypatch):
    right, wrong, names = MUTANTS[mutant]
    shutil.copytree(source.kernel_folder(), tmp_path / "kernels")
    file = tmp_path / "kernels/include/geometry/curve.clh"
    text = file.read_text()
    assert text.count(right) == 1
    file.write_text(text.replace(right, wrong))
    monkeypatch.setattr(source, "kernel_folder", lambda: tmp_path / "kernels")
    for name in names:
        with pytest.raises(AssertionError):
            test_hits_are_those_from_outside(device, name, "random", rng)


def test_other_strands_are_hit_from_the_start(device, rng):
    """Of two strands that touch, a ray from one meets the other at once, by their order too."""
    points = np.array([[[0, 0, 0], [1, 0, 0]], [[0, 0.1, 0], [1, 0.1, 0]]], float)
    curves = strands(points, RADIUS)
    n = 100
    for own, other, towards in ((0, 2, 1.0), (2, 0, -1.0)):
        origins = np.zeros((n, 3), np.float32)
        origins[:, 0], origins[:, 1] = rng.uniform(0.1, 0.9, n), curves.points[own, 1]
        d = np.tile(np.array([0, towards, 0], np.float32), (n, 1))
        t, segment, _ = hits_again(device, curves, origins, d, np.full(n, own, np.uint32))
        assert (segment == other).all()
        assert np.allclose(t, 0.1)


def cut(curves, n):
    """The same curve in strands of n points, each going on where the one before ends."""
    p = curves.points
    return strands(np.stack([p[i : i + n] for i in range(0, len(p) - n + 1, n - 1)]), RADIUS)


def test_strands_that_go_on_where_one_ends_are_others(device, rng):
    """Across an end the next vertex is another strand's, though its ball is met: it is hit."""
    curves = cut(kinked(30, 0.1, 61)(rng), 7)
    segment = rng.choice(np.concatenate([curves.offsets[:-1], curves.offsets[1:] - 2]), 4000)
    origins = 0.5 * (curves.points[segment] + curves.points[segment + 1])
    d = random_directions(rng, origins).astype(np.float32)
    t, found, _ = hits_again(device, curves, origins, d, segment)
    expected_t, _, _ = Segments(curves).closest(
        origins.astype(np.float64),
        unit(d.astype(np.float64)),
        np.searchsorted(curves.segment_vertices(), segment),
    )
    expected_t[np.isinf(expected_t)] = -1.0
    same = np.abs(np.where(np.isinf(t), -1.0, t) - expected_t) < 1e-4 * RADIUS
    assert same.mean() > 0.998
    next_one = np.isin(found.astype(np.int64) - segment, (2, -2))
    assert (next_one & (t < 0.1)).mean() > 0.1


@pytest.mark.parametrize("n_points", [1000, 16_000])
def test_a_long_strand_costs_what_short_ones_do(device, n_points, rng):
    """A yarn in one strand and in strands of 100 points: the same blocks and segments a ray, and
    what is decided once a ray is bounded."""
    t = np.linspace(0.0, 0.01 * n_points, n_points)
    yarn = np.stack([np.sin(t), np.sin(1.3 * t + 1.0), np.cos(0.7 * t)], axis=1)
    joined = Curves.from_arrays(yarn.astype(np.float32), 0.004, [0, n_points])
    cut = Curves.from_arrays(joined.points, 0.004, np.arange(0, n_points + 1, 100))
    segment = rng.choice(cut.segment_vertices(), 4000).astype(np.uint32)
    origins = 0.5 * (joined.points[segment] + joined.points[segment + 1])
    d = random_directions(rng, origins).astype(np.float32)
    counts = []
    for curves in (joined, cut):
        tracer = Tracer(device, curves)
        counts.append(count_rays(tracer, Rays(tracer.memory, origins, d, np.inf, segment)))
    assert counts[0].left.mean() < 1.6
    assert counts[0].left.max() < 40
    assert counts[0].blocks.mean() == pytest.approx(counts[1].blocks.mean(), rel=0.05)
    assert counts[0].segments.mean() == pytest.approx(counts[1].segments.mean(), rel=0.05)
