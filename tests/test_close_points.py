"""Points closer than the fibre is thick: what goes, what stays, and that nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest
from ray_reference import brute_force, random_walks, rays_at, unit

from furcl.groom.close_points import SHORTEST
from furcl.groom.curves import Curves

RADIUS = 0.15


def doubled(points, radii, distance, rng):
    """Every point again, so far away in a direction at random; strands of twice as many points."""
    s, k, _ = points.shape
    again = points + distance * unit(rng.standard_normal(points.shape))
    both = np.stack([points, again], axis=2).reshape(s, 2 * k, 3)
    return both.astype(np.float32), np.repeat(radii, 2, axis=1).astype(np.float32)


def walks(rng, s=50, k=6):
    curves = random_walks(rng, s, k, 1.0, RADIUS, taper=0.5)
    return curves.points.reshape(s, k, 3), curves.radii.reshape(s, k)


def tangents(curves):
    first = curves.segment_vertices()
    return unit((curves.points[first + 1] - curves.points[first]).astype(np.float64))


@pytest.mark.parametrize("distance", [0.0, 1e-17, 1e-8, 1e-4, 2e-3])
def test_doubled_points_are_as_if_they_were_not(distance, rng):
    """Up to 1/37 of the smallest radius away: the groom is the one without them, to the bit."""
    points, radii = walks(rng)
    curves = Curves.from_arrays(*doubled(points, radii, distance, rng)).traced()
    plain = Curves.from_arrays(points, radii)
    for name in ("points", "radii", "offsets"):
        assert np.array_equal(getattr(curves, name), getattr(plain, name))
    assert sum(curves.dropped.values()) == curves.n_points


def test_points_farther_apart_stay(rng):
    """The twin: a tenth of the radius is a part of the strand's course."""
    points, radii = walks(rng)
    curves = Curves.from_arrays(*doubled(points, radii, 0.1 * RADIUS, rng))
    assert curves.n_points == 2 * radii.size
    assert curves.traced() is curves


@pytest.mark.parametrize("distance", [0.0, 1e-17, 1e-8, 1e-3])
@pytest.mark.parametrize("at", [1, 2, 3, 4])
def test_a_step_of_the_radius_stays_a_step(distance, at, rng):
    """At a doubled point; at the last one, too, and twice in a row at the one before it."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 0]])
    radii = np.full(5, RADIUS)
    times = 2 if at == 3 else 1
    for i in range(times):
        beside = points[at] + distance * unit(rng.standard_normal(3))
        points = np.insert(points, at + 1 + i, beside, axis=0)
        radii = np.insert(radii, at + 1 + i, 0.5 ** (i + 1) * RADIUS)
    radii[at + times :] = radii[at + times]
    curves = Curves.from_arrays(points, radii, [0, len(points)]).traced()
    assert curves.n_points == 5 + times
    assert np.array_equal(curves.radii, radii.astype(np.float32))
    np.testing.assert_allclose(tangents(curves), np.tile([1.0, 0, 0], (4 + times, 1)), atol=1e-5)
    np.testing.assert_allclose(curves.points, points, atol=times * SHORTEST * RADIUS)


def test_a_finely_sampled_strand_is_thinned_and_keeps_its_course(rng):
    """Points a thousandth of a radius apart on a helix: what is left is nowhere farther from the
    helix than 1/16 of the radius, and no segment is short."""
    t = np.linspace(0.0, 1.0, 20_001)
    helix = np.stack([np.cos(6 * t), np.sin(6 * t), 3 * t], axis=1)
    curves = Curves.from_arrays(helix, RADIUS, [0, len(helix)]).traced()
    length = np.linalg.norm(np.diff(curves.points, axis=0), axis=1)
    assert length.min() >= SHORTEST * RADIUS
    assert length.max() < 4 * SHORTEST * RADIUS
    gap = np.abs(curves.points[:, None, :].astype(np.float64) - helix[None, ::10]).sum(-1).min(1)
    assert gap.max() < RADIUS / 16
    np.testing.assert_allclose(curves.points[[0, -1]], helix[[0, -1]], atol=RADIUS / 16)


def test_a_strand_shorter_than_its_radius_stays(rng):
    points = (1e-4 * rng.random((20, 7, 3)) + rng.random((20, 1, 3))).astype(np.float32)
    curves = Curves.from_arrays(points, RADIUS).traced()
    assert (np.diff(curves.offsets) == 2).all()
    assert curves.dropped["short_segments"] == 20 * 5


@pytest.mark.parametrize("seed", range(20))
def test_what_is_left_has_nothing_to_take_out(seed):
    """Jagged strands on all scales with radii at random: a second time nothing changes."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(2, 40, 30)
    steps = unit(rng.standard_normal((counts.sum(), 3)))
    points = np.cumsum(steps * 10.0 ** rng.uniform(-6, 0, (len(steps), 1)), axis=0)
    radii = RADIUS * 10.0 ** rng.choice([0.0, 0.0, 0.0, -1.0, 1.0], len(points))
    once = Curves.from_arrays(points, radii, np.cumsum([0, *counts])).traced()
    assert once.dropped["short_segments"] > 10
    twice = once.traced()
    assert dict(twice.dropped) == dict(once.dropped)
    assert np.array_equal(twice.points, once.points)
    assert np.array_equal(twice.radii, once.radii)


def test_colours_go_with_their_points(rng):
    points, radii = walks(rng, 3, 4)
    points, radii = doubled(points, radii, 1e-6, rng)
    colours = rng.random(points.shape).astype(np.float32)
    curves = Curves.from_arrays(points, radii, colours=colours).traced()
    assert curves.colours is not None
    assert np.array_equal(curves.colours, colours[:, ::2].reshape(-1, 3))


def test_rays_see_no_disc(rng):
    """Of rays at a strand with a copy of a point 1e-8 beside it, none hits a segment across it."""
    points = np.array([[0, 0, -1.0], [0, 0, 0], [1e-8, 0, 0], [0, 0, 1.0]])
    raw = Curves.from_arrays(points, RADIUS, [0, 4])
    curves = raw.traced()
    origins, directions = rays_at(rng, curves, 4000)
    _, segment, _, _ = brute_force(curves, origins, directions)
    across = np.abs(tangents(curves)[:, 0]) > 0.1
    assert not across[segment[segment < 4]].any()
    # The twin: without cleaning, a good part of the hits is on a segment that goes across.
    _, segment, _, _ = brute_force(raw, origins, directions)
    assert (segment[segment < 4] == 1).mean() > 0.03


def merged(curves, *others):
    parts = [curves, *others]
    offsets = [curves.offsets[:1], *(c.offsets[1:] for c in parts)]
    ends = np.cumsum([0, *(c.n_points for c in parts)])
    return Curves.from_arrays(
        np.concatenate([c.points for c in parts]),
        np.concatenate([c.radii for c in parts]),
        np.concatenate([o + at for o, at in zip(offsets, [0, *ends], strict=False)]),
    )


def test_a_groom_merged_with_itself_is_the_groom(rng):
    curves = random_walks(rng, 200, 6, 0.1, 0.01)
    twice = merged(curves, curves).traced()
    assert dict(twice.dropped) == {"copied_strands": 200}
    for name in ("points", "radii", "offsets"):
        assert np.array_equal(getattr(twice, name), getattr(curves, name))


@pytest.mark.parametrize("other", ["point", "radius", "order"])
def test_strands_that_are_not_the_same_stay(other, rng):
    curves = random_walks(rng, 200, 6, 0.1, 0.01)
    points, radii = curves.points.copy(), curves.radii.copy()
    if other == "point":
        points[4::6, 1] = np.nextafter(points[4::6, 1], np.float32(9.0))
    elif other == "radius":
        radii[4::6] = np.nextafter(radii[4::6], np.float32(9.0))
    else:
        points = points.reshape(-1, 6, 3)[:, ::-1].reshape(-1, 3)
    both = merged(curves, Curves(points, radii, curves.offsets))
    assert both.n_strands == 400
    assert both.traced() is both
