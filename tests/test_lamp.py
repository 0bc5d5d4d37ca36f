"""A light in the scene, from outside furcl: host, device and pictures."""

from __future__ import annotations

import math
from functools import partial

import light_kernels
import numpy as np
import pytest
from direction_statistics import SphereBins, chi_square_p, sidak
from sphere_lamp import SPHERE, SphereLamp, lit_fibre, registered_lamp

from furcl import bcsdf
from furcl.errors import SceneError
from furcl.groom.curves import Curves
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene

LAMP = SphereLamp(np.array([1.0, -2.0, 0.5]), 0.5, np.array([1.0, 2.0, 3.0]))
# From near to far: the lamp fills cones of 80, 30 and 0.3 degrees about its centre.
POINTS = {
    "near": LAMP.centre - 0.5 / math.sin(math.radians(80.0)) * np.array([0.0, 0.0, 1.0]),
    "aside": LAMP.centre + np.array([0.8, 0.6, 0.0]),
    "far": LAMP.centre + 100.0 * np.array([-0.48, 0.6, 0.64]),
}
N_SAMPLES = 400_000


def uniform(rng, n):
    """Numbers (n, 2) in [0, 1) that float32 holds, the corners among them."""
    u = rng.integers(0, 1 << 24, (n, 2)) / (1 << 24)
    u[:4] = [[0.0, 0.0], [0.0, 1.0 - 2**-24], [1.0 - 2**-24, 0.0], [1.0 - 2**-24, 1.0 - 2**-24]]
    return u.astype(np.float32)


@pytest.mark.parametrize("place", ["near", "aside"])
def test_device_density_integrates_to_one(device, place):
    density = partial(light_kernels.lookup, device, LAMP, POINTS[place])
    total = SphereBins(8, 16).integrals(lambda d: density(d).pdf.astype(np.float64), 90).sum()
    assert total == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("place", POINTS)
def test_device_density_is_the_hosts(device, place, rng):
    """Over the cone's edge too: directions within 1e-3 of its width are left out."""
    axis = (LAMP.centre - POINTS[place]) / np.linalg.norm(LAMP.centre - POINTS[place])
    width = 0.5 / np.linalg.norm(LAMP.centre - POINTS[place])
    directions = axis + 1.5 * width * rng.normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions.astype(np.float32)
    expected = LAMP.pdf(POINTS[place], directions.astype(np.float64))
    sine = np.linalg.norm(np.cross(directions, axis), axis=1)
    clear = np.abs(sine - width) > 1e-3 * width
    assert clear.mean() > 0.99
    assert 0.1 < (expected > 0.0).mean() < 0.9
    found = light_kernels.lookup(device, LAMP, POINTS[place], directions)
    np.testing.assert_allclose(found.pdf[clear], expected[clear], rtol=1e-5)
    assert not found.radiance.any()


@pytest.mark.parametrize("place", POINTS)
def test_device_samples_are_the_hosts(device, place, rng):
    u = uniform(rng, 20_000)
    found = light_kernels.sample(device, LAMP, POINTS[place], u)
    expected = LAMP.sample(POINTS[place], u.astype(np.float64))
    np.testing.assert_allclose(found.directions, expected.directions, atol=1e-6)
    np.testing.assert_allclose(found.pdf, expected.pdf, rtol=1e-5)
    np.testing.assert_array_equal(found.radiance, expected.radiance)


@pytest.mark.parametrize("place", POINTS)
def test_distances_end_at_the_near_side(device, place, rng):
    u, point = uniform(rng, 20_000), POINTS[place]
    far = np.linalg.norm(LAMP.centre - point)
    host = LAMP.sample(point, u.astype(np.float64))
    for sample, error in ((host, 1e-9), (light_kernels.sample(device, LAMP, point, u), 1e-6)):
        directions = sample.directions.astype(np.float64)
        out = point + sample.distances[:, None].astype(np.float64) * directions - LAMP.centre
        radii = np.linalg.norm(out, axis=1)
        assert np.abs(radii - LAMP.radius).max() < error * far
        assert (np.sum(out * directions, axis=1) <= error * far).all()


@pytest.mark.parametrize("place", POINTS)
def test_samples_bring_the_light_of_a_sphere(device, place, rng):
    """Irradiance of a plane that faces a sphere: pi L (r / d)^2."""
    point = POINTS[place]
    axis = LAMP.centre - point
    found = light_kernels.sample(device, LAMP, point, uniform(rng, N_SAMPLES))
    cosine = found.directions @ (axis / np.linalg.norm(axis))
    values = found.radiance[:, 1] * cosine / found.pdf
    expected = math.pi * 2.0 * (LAMP.radius / np.linalg.norm(axis)) ** 2
    error = values.std(dtype=np.float64) / math.sqrt(N_SAMPLES)
    assert abs(values.mean(dtype=np.float64) - expected) < 4.0 * error + 1e-5 * expected


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.02], ids=["true", "mutant"])
@pytest.mark.parametrize("place", ["near", "aside"])
def test_device_samples_follow_the_hosts_density(device, place, factor, rng):
    """In cells about the lamp, so that its edge is an edge of the cells."""
    point = POINTS[place]
    found = light_kernels.sample(device, LAMP, point, uniform(rng, N_SAMPLES))
    axis = (LAMP.centre - point) / np.linalg.norm(LAMP.centre - point)
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(axis, side), axis])
    edge = math.asin(LAMP.radius / np.linalg.norm(LAMP.centre - point))
    one_minus_cos = 1.0 - (found.directions @ frame.T)[:, 2]
    row = np.minimum((one_minus_cos / (1.0 - math.cos(edge)) * 10).astype(int), 9)
    turns = np.arctan2(found.directions @ frame[1], found.directions @ frame[0]) / (2.0 * math.pi)
    column = np.floor(turns * 20.0).astype(int) % 20
    counts = np.bincount(row * 20 + column, minlength=200)
    middle = (np.arange(10) + 0.5) / 10 * (1.0 - math.cos(edge))
    directions = (
        np.stack([np.sqrt(middle * (2.0 - middle)), 0.0 * middle, 1.0 - middle], axis=1) @ frame
    )
    cell = 2.0 * math.pi * (1.0 - math.cos(edge)) / 200
    expected = np.repeat(LAMP.pdf(point, directions) * cell * N_SAMPLES, 20) * factor
    assert expected.sum() == pytest.approx(N_SAMPLES * factor)
    p = chi_square_p(counts, expected)
    assert (p >= sidak(2)) == (factor == 1.0), f"p = {p:.3g}"


def test_no_light_inside_the_lamp(device, rng):
    points = LAMP.centre + 0.28 * rng.uniform(-1.0, 1.0, (1000, 3))
    found = light_kernels.sample(device, LAMP, points, uniform(rng, 1000))
    assert not found.pdf.any()
    assert not LAMP.sample(points, rng.random((1000, 2))).pdf.any()


def strands(*blockers):
    """A fibre of radius 0.2 along x through the origin, and others through (0, y, z)."""
    middles = [(0.0, 0.0, 0.2), *blockers]
    points = [[(x, y, z) for x in (-2.0, 2.0)] for y, z, _ in middles]
    radii = np.repeat([radius for _, _, radius in middles], 2)
    return Curves.from_arrays(np.reshape(points, (-1, 3)), radii, 2 * np.arange(len(middles) + 1))


def picture(device, scene, curves):
    renderer = Renderer(scene, device, curves=curves)
    renderer.advance(scene.render.spp)
    return renderer.image()


def difference(image, values):
    """Of a picture's mean from that of independent values, second channel, in standard errors."""
    variance = image.variance[..., 1].mean() / image.variance[..., 1].size
    variance += values.var() / len(values)
    return (image.rgb[..., 1].mean() - values.mean()) / math.sqrt(variance)


# Half way to the lamp, and twice as far as it.
IN_FRONT, BEHIND = ([0.25, -1.0, 0.75], 0.45), ([1.0, -4.0, 3.0], 0.8)


@pytest.mark.parametrize("light_sampling", ["auto", "mis"])
@pytest.mark.parametrize("blocker", ["strand", "body"])
def test_only_what_is_nearer_than_the_lamp_shades_it(device, light_sampling, blocker):
    document = lit_fibre(SPHERE, light_sampling=light_sampling, spp=64)

    def lit(place):
        body, others = {}, []
        if place is not None:
            middle, radius = place
            body = {"body": {"centre": middle, "radii": [radius] * 3}}
            others = [(*middle[1:], radius)]
        if blocker == "strand":
            return picture(device, decode_scene(document), strands(*others)).rgb
        return picture(device, decode_scene({**document, **body}), strands()).rgb

    with registered_lamp():
        alone, behind, in_front = (lit(place) for place in (None, BEHIND, IN_FRONT))
    assert (alone > 0.0).all()
    np.testing.assert_allclose(behind, alone, rtol=1e-5)
    assert not in_front.any()


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.03], ids=["true", "mutant"])
def test_a_body_has_the_light_of_the_lamp(device, factor, rng):
    """A white ball whose front the camera sees, and a lamp of its size before it: radiance is a
    part 1 / pi of the irradiance. Weighed against rays that never find the lamp, a fifth would be
    missing."""
    environment = {**SPHERE, "centre": [0.0, -3.0, 0.0], "radius": 1.0}
    document = lit_fibre(environment, spp=1024)
    body = {"centre": [0.0, 0.0, 0.0], "radii": [1.0, 1.0, 1.0], "albedo": 1.0}
    with registered_lamp():
        scene = decode_scene({**document, "body": body})
        found = picture(device, scene, strands())
        light = scene.build_light()
    n = 200_000
    half = 199.0 * math.tan(math.radians(0.05))
    across = rng.uniform(-half, half, (n, 2))
    depth = -np.sqrt(1.0 - np.sum(across**2, axis=1))
    points = np.stack([across[:, 0], depth, across[:, 1]], axis=1)
    sample = light.sample(points, rng.random((n, 2)))
    cosine = np.maximum(np.sum(sample.directions * points, axis=1), 0.0)
    values = sample.radiance[:, 1] * cosine / sample.pdf / math.pi
    z = difference(found, factor * values)
    assert (abs(z) < 3.5) == (factor == 1.0), f"z = {z}"


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.03], ids=["true", "mutant"])
def test_a_fibre_has_the_light_of_the_lamp(device, factor, rng):
    """The mean over the picture is the far field of the fibre under the lamp, by float64.

    Rays that leave the scene do not find the lamp, so nothing of its light may be left to them: the
    lamp is large, they would have 8 % of it.
    """
    with registered_lamp():
        scene = decode_scene(lit_fibre({**SPHERE, "radius": 1.5}, spp=16384))
        found = picture(device, scene, strands())
        light = scene.build_light()
    n = 200_000
    half = 200.0 * math.tan(math.radians(0.05))
    points = rng.uniform(-half, half, (n, 1)) * [1.0, 0.0, 0.0]
    sample = light.sample(points, rng.random((n, 2)))
    wo = np.broadcast_to([0.0, -1.0, 0.0], (n, 3))
    scattered = bcsdf.evaluate(scene.build_fibre(), wo, sample.directions, rng.uniform(-1, 1, n))
    values = (scattered * sample.radiance / sample.pdf[:, None])[:, 1]
    z = difference(found, factor * values)
    assert (abs(z) < 3.5) == (factor == 1.0), f"z = {z}"


def test_a_lamp_that_rays_cannot_find_must_be_sampled(device):
    with registered_lamp():
        scene = decode_scene(lit_fibre(SPHERE, light_sampling="bcsdf"))
        with pytest.raises(SceneError, match=r"'bcsdf' never finds .*'sphere'; allowed are"):
            Renderer(scene, device)
