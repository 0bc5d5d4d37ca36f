"""Lamps in the kernels against their float64 twins, and what samples and rays must agree on."""

from __future__ import annotations

import re

import lamp_kernels
import msgspec
import numpy as np
import pytest
from direction_statistics import chi_square_p, sidak
from lamp_kernels import MIDDLE, POINTS, lamps_of

from furcl.light.lamps.lamps import Lamps
from furcl.light.lamps.planar import flat
from furcl.light.lights import Lights

SCENES = lamp_kernels.scenes()
N = 40_000


def numbers(rng, n, width):
    """Numbers (n, width) in [0, 1) that float32 holds, the ends among them."""
    u = rng.integers(0, 1 << 24, (n, width)) / (1 << 24)
    u[0], u[1] = 0.0, 1.0 - 2.0**-24
    return u


def rounded(values) -> np.ndarray:
    """Float64 that float32 holds."""
    return np.asarray(values).astype(np.float32).astype(np.float64)


def drawn(device, lights: Lights, point, rng, n=N):
    """Light samples of a point by device and host, from the same numbers."""
    points = np.broadcast_to(np.float32(point).astype(np.float64), (n, 3))
    u, choice = numbers(rng, n, 2), numbers(rng, n, 4)
    found = lamp_kernels.choose(device, lights, points, u, choice)
    return found, lights.sample(points, u, choice, MIDDLE), points


@pytest.mark.parametrize("place", range(len(POINTS)))
@pytest.mark.parametrize("name", SCENES)
def test_samples_are_the_hosts(device, name, place, rng):
    """Up to rounding, which sends at most one number in 2000 to another lamp or texel."""
    found, host, _ = drawn(device, SCENES[name], POINTS[place], rng)
    samples = host.samples
    lit = samples.pdf > 0.0
    assert ((found.pdf > 0.0) == lit).mean() > 0.9995
    both = lit & (found.pdf > 0.0)
    if not both.any():
        return
    same = np.linalg.norm(found.directions - samples.directions, axis=1) < 2e-3
    same &= np.isclose(found.pdf, samples.pdf, rtol=3e-4)
    same &= np.isclose(found.radiance, samples.radiance, rtol=3e-4, atol=1e-6).all(axis=1)
    same &= np.isclose(found.distances, samples.distances, rtol=1e-4)
    same &= found.found == host.rays_find_it
    assert same[both].mean() > 0.9995
    np.testing.assert_allclose(np.linalg.norm(found.directions[both], axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("name", [n for n, s in SCENES.items() if lamps_of(s).part().area])
def test_rays_meet_the_lamps_that_the_host_says(device, name, rng):
    """From points all around, in all directions and to the lamps; edges excepted."""
    lights = SCENES[name]
    points = rounded(rng.uniform(-2.0, 2.0, (N, 3)) + MIDDLE)
    aims = rng.normal(0.0, 1.0, (N, 3)) + MIDDLE
    lamps = lamps_of(lights)
    placed = lamps.records[: lamps.n_placed]
    aims[::2] = placed["centre"][rng.integers(0, len(placed), N // 2)]
    aims[::2] += rng.normal(0.0, 0.2, (N // 2, 3))
    directions = rounded((aims - points) / np.linalg.norm(aims - points, axis=1)[:, None])
    t, lamp = lamp_kernels.trace(device, lights, points, directions)
    expected_t, expected = lamps.closest(points, directions)
    agree = lamp == expected
    assert agree.mean() > 0.9998
    met = agree & (lamp >= 0)
    assert met.mean() > 0.002
    np.testing.assert_allclose(t[met], expected_t[met], rtol=1e-4, atol=1e-5)
    ignoring = lamp_kernels.trace(device, lights, points, directions, ignored=lamp)[1]
    assert (ignoring[met] != lamp[met]).all()


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("name", SCENES)
def test_rays_weigh_light_by_the_density_of_samples(device, name, place, rng):
    """A ray along a light sample meets its lamp where the sample says. Its weight against light
    samples is that of the sample's own density, and rays in all directions are weighed as the host
    says."""
    lights = SCENES[name]
    found, host, points = drawn(device, lights, POINTS[place], rng)
    area = (found.pdf > 0.0) & host.rays_find_it & (host.lamp >= 0)
    area &= np.isclose(found.pdf, host.samples.pdf, rtol=3e-4)
    aims = found.directions[area].astype(np.float64)
    ways = rng.normal(size=(N // 4, 3))
    directions = np.concatenate([aims, ways / np.linalg.norm(ways, axis=1)[:, None]])
    origins = np.concatenate([points[area], points[: N // 4]])
    if lamps_of(lights).part().area:
        t, met = lamp_kernels.trace(device, lights, origins, directions)
    else:  # of triangles rays meet the mesh
        t, met = lamps_of(lights).closest(origins, directions)
    first = np.zeros(0, bool)
    if len(aims):
        lamp, distances = host.lamp[area], found.distances[area]
        first, blocked = met[: len(aims)] == lamp, t[: len(aims)] < 0.999 * distances
        # Rounding moves rays at an edge past it.
        assert (first | blocked).mean() > 0.9995
        assert first.mean() > 0.3
        # Samples of triangles end a little before them, the more the flatter they are seen.
        ends = 1e-4 if lamps_of(lights).part().area else 3e-4
        np.testing.assert_allclose(t[: len(aims)][first], distances[first], rtol=ends)
    for density in (0.0, 0.7):
        pdf = np.full(len(directions), density)
        seen = lamp_kernels.weigh(device, lights, origins, directions, pdf, met, t)
        expected = lights.radiance_of_rays(
            origins, directions, pdf, (t.astype(np.float64), met), MIDDLE
        )
        close = np.isclose(seen, expected, rtol=1e-3, atol=1e-6).all(axis=1)
        assert close.mean() > 0.999
        if len(aims):
            weight = density / (density + found.pdf[area]) if density else np.ones(len(aims))
            own = found.radiance[area] * weight[:, None]
            same = np.all(np.isclose(seen[: len(aims)], own, rtol=1e-3), axis=1)
            assert np.mean(same[first]) > 0.9995


def closed_forms() -> dict[str, tuple[Lights, np.ndarray, np.ndarray, float]]:
    """Lights, a point, its normal, and the irradiance there."""
    from furcl.scene.lamps import DiskLamp, DistantLamp, PointLamp, QuadLamp, SphereLamp, SpotLamp

    at, up = (0.0, 0.0, 2.0), np.array([0.0, 0.0, 1.0])
    # A rectangle a x b over its corner's foot at height c (Siegel and Howell, configuration 11).
    x, y = 0.6 / 2.0, 0.4 / 2.0
    corner = (
        x / np.hypot(1, x) * np.arctan(y / np.hypot(1, x))
        + y / np.hypot(1, y) * np.arctan(x / np.hypot(1, y))
    ) / (2.0 * np.pi)
    facing = DistantLamp(angle_deg=40.0, irradiance=1.7)
    lamps = {
        "quad": (QuadLamp(size=(1.2, 0.8), radiance=3.0, position=at), 3.0 * np.pi * 4.0 * corner),
        "disk": (DiskLamp(radius=0.7, radiance=3.0, position=at), 3.0 * np.pi * 0.49 / 4.49),
        "sphere": (SphereLamp(radius=0.7, radiance=3.0, position=at), 3.0 * np.pi * 0.49 / 4.0),
        "point": (PointLamp(intensity=3.0, position=at), 3.0 / 4.0),
        "spot": (SpotLamp(intensity=3.0, cone_deg=20.0, position=at), 3.0 / 4.0),
        "sun": (facing, 1.7),
        "direction": (DistantLamp(angle_deg=0.0, irradiance=1.7), 1.7),
        "a sphere's power, far away": (
            SphereLamp(radius=0.01, power=5.0, position=at), 5.0 / (4.0 * np.pi) / 4.0
        ),
        "a point's power": (PointLamp(power=5.0, position=at), 5.0 / (4.0 * np.pi) / 4.0),
        "a quad's power": (
            QuadLamp(size=(0.01, 0.02), power=5.0, position=at), 5.0 / np.pi / 4.0
        ),
    }  # fmt: skip
    return {
        name: (lamp_kernels.build({"lamp": lamp}), np.zeros(3), up, value)
        for name, (lamp, value) in lamps.items()
    }


FORMS = closed_forms()


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.02], ids=["true", "mutant"])
@pytest.mark.parametrize("name", FORMS)
def test_irradiance_is_the_closed_form(device, name, factor, rng):
    lights, point, normal, expected = FORMS[name]
    found, _, _ = drawn(device, lights, point, rng, 200_000)
    values = found.radiance[:, 1].astype(np.float64) * (found.directions @ normal)
    values = np.divide(values, found.pdf, out=np.zeros(len(values)), where=found.pdf > 0.0)
    error = values.std() / np.sqrt(len(values)) + 2e-5 * expected
    assert (abs(values.mean() - factor * expected) < 4.0 * error) == (factor == 1.0)


def test_a_spot_sends_out_its_power():
    """Its intensity by the midpoint rule over the cosine with its axis."""
    lights = lamp_kernels.build({"spot": lamp_kernels.ONES["spot"]})
    lamps = lamps_of(lights)
    spot = lamps.records
    n = 200_000
    cosine = (np.arange(n) + 0.5) / n * 2.0 - 1.0
    axis = spot["axis"][0]
    side = np.cross(axis, [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    ways = cosine[:, None] * axis + np.sqrt(1.0 - cosine**2)[:, None] * side
    which = np.zeros(n, int)
    samples = lamps.sample(which, spot["centre"] + ways, np.zeros((n, 2)))
    assert 4.0 * np.pi * samples.radiance[:, 0].mean() == pytest.approx(2.0, rel=1e-4)


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.05], ids=["true", "mutant"])
@pytest.mark.parametrize("name", ["triangles", "quads", "by power", "all"])
def test_lamps_are_taken_as_often_as_their_chance_says(device, name, factor, rng):
    """Chi-square over the lamps, of chances by the host. The mutant: lamps of an odd number are
    said to be taken more often."""
    lights, n = SCENES[name], 400_000
    family = 4 * 2
    for point in POINTS[:2]:
        found, host, _ = drawn(device, lights, point, rng, n)
        near = lights.near_chance(point[None], MIDDLE)[0]
        lamps = lamps_of(lights)
        assert lamps.tree is not None
        which = np.arange(lamps.n_placed)
        chances = near * lamps.tree.chance(
            which, np.broadcast_to(point, (len(which), 3)), lamps.by_position
        )
        # Of lamps without an area the device does not say which: the host's, whose numbers agree.
        taken = np.where(found.lamp >= 0, found.lamp.astype(int), host.lamp)
        counts = np.bincount(taken + 1, minlength=len(which) + 1)
        biased = chances * np.where(which % 2, factor, 2.0 - factor)
        expected = n * np.append(1.0 - near, biased)
        lost = n - expected.sum()
        assert abs(lost) < 0.3 * n
        counts[0] = n - counts[1:].sum()
        expected[0] += lost if factor != 1.0 or lost > 1e-6 * n else 0.0
        p = chi_square_p(counts, np.maximum(expected, 1e-9))
        assert (p >= sidak(family)) == (factor == 1.0), f"p = {p:.3g}"


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", [False, True])
@pytest.mark.parametrize("name", ["quad", "sheared quad", "disk", "sphere", "triangles"])
def test_samples_follow_the_density(device, name, mutant, rng):
    """The host's density, where its rays meet the lamp, integrated over cells of directions, by
    chi-square. The mutant: numbers that are not quite uniform."""
    lights = SCENES[name]
    if name == "triangles":
        corner, edges = (-0.5, -0.4, 2.0), ((1.0, 0.2, 0.0), (0.1, 0.9, 0.3))
        lights = Lights(None, Lamps.make([flat("triangle", corner, *edges, 1.0, flip=True)]))
    lamps = lamps_of(lights)
    record, point = lamps.records[:1], POINTS[0]
    n = 400_000
    u = numbers(rng, n, 2)
    u = np.where([mutant], u**1.03, u)
    points = np.broadcast_to(point, (n, 3))
    found = lamp_kernels.choose(device, lights, points, u, numbers(rng, n, 4))
    assert (found.pdf > 0.0).all()
    way = record["centre"][0] - point
    axis = way / np.linalg.norm(way)
    side = np.cross(axis, [0.3, 0.8, 0.1])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(axis, side)])
    directions = found.directions.astype(np.float64)
    seen = directions @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    cells = 12
    index = np.minimum(((seen - low) / (high - low) * cells).astype(int), cells - 1)
    counts = np.bincount(index[:, 0] * cells + index[:, 1], minlength=cells**2)
    # Integral of the density over each cell on a fine grid of the tangent plane's coordinates.
    fine = 80
    grid = (np.arange(cells * fine) + 0.5) / (cells * fine)
    a, b = np.meshgrid(*(low[k] + grid * (high[k] - low[k]) for k in (0, 1)), indexing="ij")
    cosine = np.sqrt(np.maximum(1.0 - a**2 - b**2, 0.0))
    rays = (
        a.ravel()[:, None] * frame[0]
        + b.ravel()[:, None] * frame[1]
        + cosine.ravel()[:, None] * axis
    )
    t, lamp = lamps.closest(np.broadcast_to(point, rays.shape), rays)
    met = lamp >= 0
    density = np.zeros(len(rays))
    density[met] = lamps.density(
        lamp[met], np.broadcast_to(point, rays.shape)[met], rays[met], t[met]
    )
    area = np.prod((high - low) / (cells * fine))
    expected = (density * area / cosine.ravel()).reshape(cells, fine, cells, fine).sum(axis=(1, 3))
    assert expected.sum() == pytest.approx(1.0, abs=3e-3)
    expected = n * expected.ravel() / expected.sum()
    # Cells on the lamp's edge are known to the grid's resolution only.
    inner = (density.reshape(cells, fine, cells, fine) > 0.0).all(axis=(1, 3)).ravel()
    assert inner.sum() > 30
    counts, expected = (
        np.append(counts[inner], counts[~inner].sum()),
        np.append(expected[inner], expected[~inner].sum()),
    )
    expected[-1] = n - expected[:-1].sum()
    p = chi_square_p(counts, expected)
    assert (p >= sidak(5)) == (not mutant), f"p = {p:.3g}"


# Lamps, a point at which they are dark, and what is met from there.
DARK = {
    "behind a quad": ("quad", (2.0, -2.0, 3.0)),
    "behind a disk": ("disk", (-0.9, 0.9, 3.5)),
    "inside a sphere": ("sphere", (0.6, 1.4, 0.7)),
}


@pytest.mark.parametrize("place", DARK)
def test_dark_sides_are_met_and_dark(device, place, rng):
    """For rays of a camera and light samples; a lamp with two bright sides is not dark there."""
    name, point = DARK[place]
    n = 1000
    for one, dark in ((lamp_kernels.ONES[name], True), ("two-sided", False)):
        if isinstance(one, str):
            if name == "sphere":
                continue
            one = msgspec.structs.replace(lamp_kernels.ONES[name], two_sided=True)
        lights = lamp_kernels.build({name: one})
        centre = lamps_of(lights).records["centre"][0]
        aims = centre + 0.02 * rng.normal(size=(n, 3))
        directions = aims - point
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        points = np.broadcast_to(point, (n, 3))
        t, lamp = lamp_kernels.trace(device, lights, points, directions)
        assert (lamp == 0).all()
        seen = lamp_kernels.weigh(device, lights, points, directions, np.zeros(n), lamp, t)
        found, _, _ = drawn(device, lights, point, rng, n)
        assert ((seen == 0.0).all(), (found.pdf == 0.0).all()) == (dark, dark)


MUTANTS = {
    "the back of a quad shines": (r"(lamp\[LAMP_TWO_SIDED\]) > 0\.0f", r"\1 >= 0.0f"),
    "a disk's radius is not the root": (r"sqrt\(xi\.x\) \* \(float2\)", "xi.x * (float2)"),
    "halves are confused": (r"trail & 1u \? second : first", "trail & 1u ? first : second"),
    "a chance is forgotten": (r"taken\.chance \* placed", "placed"),
    "a distance is not squared": (r"distance \* distance / \(lamp", "distance / (lamp"),
    "no square of the distance": (r"/ fmax\(distance_sq, 1e-30f\)", "/ sqrt(distance_sq)"),
    "the far side of a sphere": (r"\(1\.0f - one_minus_cos\) -", "(1.0f - one_minus_cos) +"),
}  # fmt: skip


@pytest.mark.parametrize("mutant", MUTANTS)
def test_mutants_are_seen(device, monkeypatch, rng, mutant):
    """By the comparison with the host, or of rays with samples."""
    pattern, text = MUTANTS[mutant]

    def mutated(source: str) -> str:
        changed, count = re.subn(pattern, text, source)
        assert count == 1
        return changed

    monkeypatch.setattr(lamp_kernels, "program_text", mutated)
    with pytest.raises(AssertionError):
        compare_all(device, rng)


def compare_all(device, rng):
    """The tests that see mistakes in any kind."""
    for place in DARK:
        test_dark_sides_are_met_and_dark(device, place, rng)
    for place in (0, 2):
        test_samples_are_the_hosts(device, "all", place, rng)
        test_rays_weigh_light_by_the_density_of_samples(device, "all", place, rng)
