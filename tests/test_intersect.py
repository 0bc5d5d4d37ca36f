"""Rays on the device against float64 brute force and against Embree."""

from __future__ import annotations

import numpy as np
import pytest
from ray_reference import (
    brute_force,
    nested,
    random_directions,
    random_walks,
    rays_at,
    strands,
    unit,
)

from furcl.device import launch
from furcl.device.layout import NO_SEGMENT
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves
from furcl.oracle.embree_rays import EmbreeScene
from furcl.rendering.rays import Rays, Tracer


def trace(device, curves, origins, directions, *arguments):
    """Nearest hits on the device: t, segment, u."""
    tracer = Tracer(device, curves)
    rays = Rays(tracer.memory, origins, directions, *arguments)
    tracer.closest(rays)
    return tracer.hits(rays)


def occluded(device, curves, origins, directions, *arguments):
    tracer = Tracer(device, curves)
    rays = Rays(tracer.memory, origins, directions, *arguments)
    tracer.shadow(rays)
    return tracer.occluded(rays)


def test_one_radius_for_all_gives_the_same_bits(device):
    """Hits with the radius kept once equal those with a radius per point."""
    rng = np.random.default_rng(5)
    curves = random_walks(rng, 60, 8, 0.2, 0.01)
    assert curves.one_radius
    origins, directions = rays_at(rng, curves, 2000)
    found = []
    for point_radii in (True, False):
        tracer = Tracer(device, curves, point_radii)
        rays = Rays(tracer.memory, origins, directions)
        tracer.closest(rays)
        found.append(tracer.hits(rays))
    assert (found[0][1] != NO_SEGMENT).mean() > 0.02
    for with_radii, without in zip(*found, strict=True):
        assert np.array_equal(with_radii, without)


def scaled(curves, factor, shift=0.0):
    return Curves.from_arrays(
        curves.points * np.float32(factor) + np.float32(shift),
        curves.radii * np.float32(factor),
        curves.offsets,
    )


def check_hits(found, reference, sure=1e-3):
    """Compare hits with brute force wherever that is sure of itself: nearly everywhere."""
    t, segment, u = found
    t_ref, segment_ref, u_ref, margin = reference
    certain = margin > sure
    assert certain.mean() > 0.98
    hit = certain & (segment_ref != NO_SEGMENT)
    assert hit.mean() > 0.02
    assert np.array_equal((segment != NO_SEGMENT)[certain], (segment_ref != NO_SEGMENT)[certain])
    same = segment[hit] == segment_ref[hit]
    relative = np.abs(t[hit] - t_ref[hit]) / t_ref[hit]
    assert relative.max() < 1e-4
    assert same.mean() > 0.98  # joints, where two segments are hit at one distance
    assert np.abs(u[hit] - u_ref[hit])[same].max() < 0.01


def agreeing_hits(device, curves, rays, sure, least_sure, error):
    """The share of rays that surely hit; hits must be those of brute force, at its distances up to
    `error`, wherever its margin is above `sure`: for at least `least_sure` of the rays."""
    t, segment, _ = trace(device, curves, *rays)
    t_ref, segment_ref, _, margin = brute_force(curves, *rays)
    certain = margin > sure
    assert certain.mean() > least_sure
    assert np.array_equal((segment == NO_SEGMENT)[certain], (segment_ref == NO_SEGMENT)[certain])
    hit = certain & (segment_ref != NO_SEGMENT)
    assert np.abs(t[hit] - t_ref[hit]).max() < error
    return hit.mean()


GROOMS = {
    "one segment": lambda rng: random_walks(rng, 1, 2, 1.0, 0.1),
    "few": lambda rng: random_walks(rng, 3, 4, 0.7, 0.05),
    "walks": lambda rng: random_walks(rng, 60, 8, 0.2, 0.01, taper=0.8),
    "kinked": lambda rng: random_walks(rng, 60, 8, 0.2, 0.02, turn=5.0),
    "fine": lambda rng: random_walks(rng, 60, 30, 0.02, 0.01, turn=0.3),
    "thick": lambda rng: random_walks(rng, 20, 5, 0.1, 0.2),
    "long and thin": lambda rng: random_walks(rng, 400, 2, 3.0, 2e-3),
}


@pytest.mark.parametrize("name", GROOMS)
def test_hits_are_those_of_brute_force(device, name, rng):
    curves = GROOMS[name](rng)
    rays = rays_at(rng, curves, 4000)
    check_hits(trace(device, curves, *rays), brute_force(curves, *rays))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scale_does_not_matter(device, scale, rng):
    curves = scaled(random_walks(rng, 60, 8, 0.2, 0.01), scale)
    rays = rays_at(rng, curves, 4000)
    check_hits(trace(device, curves, *rays), brute_force(curves, *rays))


def test_a_groom_far_from_the_origin(device, rng):
    """At 1e5 a float32 has steps of 1/128; what the file says is hit exactly all the same."""
    curves = scaled(random_walks(rng, 60, 8, 20.0, 1.0), 1.0, shift=1e5)
    rays = rays_at(rng, curves, 4000)
    check_hits(trace(device, curves, *rays), brute_force(curves, *rays))


@pytest.mark.parametrize("distance", [1e2, 1e4])
def test_rays_from_far_away(device, distance, rng):
    """Rounding of the direction alone moves a ray by 1e4 * 6e-8, a fraction of the radius."""
    curves = random_walks(rng, 60, 8, 0.2, 0.02)
    target = curves.points[rng.integers(0, curves.n_points, 4000)].astype(np.float64)
    target += 0.05 * rng.standard_normal(target.shape)
    origins = (target - distance * unit(rng.standard_normal(target.shape))).astype(np.float32)
    directions = unit(target - origins).astype(np.float32)
    rays = origins, directions
    assert agreeing_hits(device, curves, rays, 1e-3, 0.9, 2e-6 * distance) > 0.2


@pytest.mark.parametrize("shares", [(128, 32, 1), (1, 1, 64)], ids=["lanes", "blocks"])
@pytest.mark.parametrize("per_size", [1, 30])
def test_deep_trees(device, shares, per_size, rng, monkeypatch):
    """Rays from beside a fibre, of which others are thousands of times smaller and larger, with a
    stack of lanes or of blocks."""
    monkeypatch.setattr(launch, "_RAYS_CPU", shares)
    monkeypatch.setattr(launch, "_RAYS_GPU", shares)
    curves = nested(rng, 6, per_size)
    middle = curves.points.reshape(-1, 2, 3).mean(axis=1)[rng.integers(0, curves.n_segments, 4000)]
    size = np.linalg.norm(middle, axis=1)[:, None]
    origins = middle + size * rng.uniform(0.1, 3.0, (4000, 1)) * random_directions(rng, 4000)
    target = middle + 0.02 * size * random_directions(rng, 4000)
    rays = origins.astype(np.float32), unit(target - origins).astype(np.float32)
    found, reference = trace(device, curves, *rays), brute_force(curves, *rays)
    check_hits(found, reference)
    assert np.array_equal(occluded(device, curves, *rays), found[1] != NO_SEGMENT)


AXES = np.concatenate([np.eye(3), -np.eye(3)])
DIAGONALS = np.array([[1, 1, 0], [-1, 0, 1], [0, 1, -1], [1e-20, 1, 0], [1e-30, -1e-30, 1]], float)


@pytest.mark.parametrize("direction", np.concatenate([AXES, DIAGONALS]), ids=str)
def test_rays_along_axes(device, direction, rng):
    """Zero components, from origins that lie on the faces of boxes too."""
    curves = random_walks(rng, 60, 8, 0.2, 0.03)
    origins = (rng.random((2000, 3)) * 2.0 - 0.5).astype(np.float32)
    corner = rng.integers(0, curves.n_points, 1000)
    origins[:1000] = curves.points[corner]
    origins[:1000] += rng.integers(-1, 2, (1000, 3)) * curves.radii[corner, None]
    origins -= 3.0 * np.rint(direction).astype(np.float32)
    directions = np.broadcast_to(unit(direction), origins.shape).astype(np.float32)
    # Corners are on the edge by construction.
    assert agreeing_hits(device, curves, (origins, directions), 1e-4, 0.7, 1e-4) > 0.01


def test_rays_along_fibres(device, rng):
    """Down the axis of every segment, and within a thousandth of it."""
    curves = random_walks(rng, 300, 2, 0.3, 0.01)
    a, b = curves.points[::2].astype(np.float64), curves.points[1::2].astype(np.float64)
    axis = unit(b - a)
    origins = (a - 0.5 * axis).astype(np.float32)
    for off in (0.0, 1e-3):
        directions = unit(axis + off * rng.standard_normal(axis.shape)).astype(np.float32)
        t, segment, _ = trace(device, curves, origins, directions)
        assert (segment != NO_SEGMENT).all()
        assert (t < 0.81).all()


def test_short_segments_of_strands(device, rng):
    """Segments a thousand times shorter than the radius leave no holes and make no hits up."""
    points = np.cumsum(1e-5 * unit(rng.standard_normal((100, 40, 3)) + 1.0), axis=1)
    curves = strands(points + rng.random((100, 1, 3)), 0.01)
    rays = rays_at(rng, curves, 1500)
    assert agreeing_hits(device, curves, rays, 1e-4, 0.95, 1e-4) > 0.01


def test_hits_beyond_t_max_do_not_count(device, rng):
    curves = random_walks(rng, 60, 8, 0.2, 0.02)
    rays = rays_at(rng, curves, 4000)
    t_ref, segment_ref, _, margin = brute_force(curves, *rays)
    hit = (segment_ref != NO_SEGMENT) & (margin > 1e-3)
    origins, directions = rays[0][hit], rays[1][hit]
    for factor, found in ((0.9999, False), (1.0001, True)):
        t_max = (factor * t_ref[hit]).astype(np.float32)
        t, segment, u = trace(device, curves, origins, directions, t_max)
        assert ((segment != NO_SEGMENT) == found).all()
        assert (occluded(device, curves, origins, directions, t_max) == found).all()
        if not found:
            assert np.array_equal(t, t_max)
            assert not u.any()


def test_any_hit_agrees_with_nearest_hit(device, rng):
    curves = random_walks(rng, 500, 10, 0.1, 0.02)
    origins, directions = rays_at(rng, curves, 20_000)
    t_max = (rng.random(len(origins)) * 2.0).astype(np.float32)
    _, segment, _ = trace(device, curves, origins, directions, t_max)
    found = occluded(device, curves, origins, directions, t_max)
    assert np.array_equal(found, segment != NO_SEGMENT)
    assert 0.1 < found.mean() < 0.9


@pytest.mark.parametrize("n", [0, 1, 3, 65, 1000])
def test_any_number_of_rays(device, n, rng):
    """A ray's result does not depend on which rays go with it."""
    curves = random_walks(rng, 100, 8, 0.2, 0.01)
    origins, directions = rays_at(rng, curves, 1000)
    everything = trace(device, curves, origins, directions)
    part = trace(device, curves, origins[:n], directions[:n])
    for found, expected in zip(part, everything, strict=True):
        assert np.array_equal(found[:n], expected[:n])


@pytest.mark.parametrize("shares", [(1, 1, 1), (1, 1, 32), (1, 1, 256), (7, 3, 2), (64, 12, 1)])
def test_how_rays_are_shared_out_does_not_matter(device, shares, rng, monkeypatch):
    """Rays of a work-item, those under way, work-items of a group: as on GPUs, and as on CPUs."""
    curves = random_walks(rng, 200, 8, 0.2, 0.01)
    origins, directions = rays_at(rng, curves, 3001)
    usual = trace(device, curves, origins, directions)
    usual_occluded = occluded(device, curves, origins, directions)
    monkeypatch.setattr(launch, "_RAYS_CPU", shares)
    monkeypatch.setattr(launch, "_RAYS_GPU", shares)
    for found, expected in zip(trace(device, curves, origins, directions), usual, strict=True):
        assert np.array_equal(found, expected)
    assert np.array_equal(occluded(device, curves, origins, directions), usual_occluded)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_rays_that_are_not_finite_end(device, value, rng):
    curves = random_walks(rng, 100, 8, 0.2, 0.01)
    origins, directions = rays_at(rng, curves, 64)
    directions[::2, 1] = value
    origins[1::4, 2] = value
    _, segment, _ = trace(device, curves, origins, directions)
    assert (segment[::2] == NO_SEGMENT).all()


def compare_with_embree(device, curves, origins, directions):
    """Share of rays whose hit is neither the same segment nor at the same distance."""
    t, segment, _ = trace(device, curves, origins, directions)
    infinite = np.full(len(origins), np.float32(1e30))
    packed = [np.column_stack([v, infinite]).astype(np.float32) for v in (origins, directions)]
    t_ref, segment_ref, _ = EmbreeScene(curves).intersect(*packed)
    both = (segment != NO_SEGMENT) & (segment_ref != NO_SEGMENT)
    assert both.mean() > 0.1
    with np.errstate(invalid="ignore", over="ignore"):
        near = both & (np.abs(t - t_ref) <= 1e-4 * t_ref)
    return (~((segment == segment_ref) | near)).mean()


@pytest.mark.parametrize(("step", "radius"), [(0.02, 1e-3), (0.2, 5e-4), (0.005, 2e-3)])
def test_hits_are_those_of_embree(device, step, radius, rng):
    curves = random_walks(rng, 4000, 10, step, radius, taper=0.7)
    assert compare_with_embree(device, curves, *rays_at(rng, curves, 50_000)) < 1e-4


@pytest.mark.parametrize("name", ["sintel_straight", "sintel_curly", "bear_fur", "bunny_fur"])
def test_hits_on_real_grooms_are_those_of_embree(device, name, shared_data, rng):
    curves = load_curves(shared_data / "hair" / f"{name}.hair")
    near = curves.points[rng.integers(0, curves.n_points, 50_000)]
    lo, hi = curves.bounds()
    origins = (near + 0.1 * (hi - lo).max() * random_directions(rng, len(near))).astype(np.float32)
    directions = unit(near - origins + 0.01 * (hi - lo).max() * rng.standard_normal(near.shape))
    assert compare_with_embree(device, curves, origins, directions.astype(np.float32)) < 1e-3
