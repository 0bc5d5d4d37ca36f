"""Environments on the host: known values, densities and sampling."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
from direction_statistics import SphereBins, chi_square_p, directions, sidak
from environments import ANYWHERE, ENVIRONMENTS, make_environment

from furcl.errors import ImageError
from furcl.light import kinds
from furcl.light.constant import ConstantEnvironment
from furcl.light.image import ImageEnvironment, ImageLight
from furcl.light.latlong import LatLong
from furcl.light.preetham import Sky, sun_illuminance, zenith_luminance

N_SAMPLES = 600_000
SKIES = [(2.0, 90.0), (3.0, 45.0), (6.0, 10.0), (10.0, 0.0)]


def make_sky(turbidity=3.0, elevation_deg=45.0, radius_deg=0.2665, **changes):
    values = {
        "sun_elevation": math.radians(elevation_deg),
        "sun_azimuth": 0.7,
        "sun_radius": math.radians(radius_deg),
        "sun_scale": 1.0,
        "turbidity": turbidity,
        "scale": 1.0,
        "ground_albedo": (0.2, 0.2, 0.2),
    }
    return Sky.make(**{**values, **changes})


def preetham_xyy(turbidity, theta_sun, theta, gamma):
    """Luminance [kcd/m^2] and chromaticity as the paper's appendix prints them, in scalars."""
    t, s = turbidity, theta_sun
    chi = (4 / 9 - t / 120) * (math.pi - 2 * s)
    zenith = {
        "Y": (4.0453 * t - 4.9710) * math.tan(chi) - 0.2155 * t + 2.4192,
        "x": t * t * (0.00166 * s**3 - 0.00375 * s**2 + 0.00209 * s)
        + t * (-0.02903 * s**3 + 0.06377 * s**2 - 0.03202 * s + 0.00394)
        + (0.11693 * s**3 - 0.21196 * s**2 + 0.06052 * s + 0.25886),
        "y": t * t * (0.00275 * s**3 - 0.00610 * s**2 + 0.00317 * s)
        + t * (-0.04214 * s**3 + 0.08970 * s**2 - 0.04153 * s + 0.00516)
        + (0.15346 * s**3 - 0.26756 * s**2 + 0.06670 * s + 0.26688),
    }
    rows = {
        "Y": (0.1787 * t - 1.4630, -0.3554 * t + 0.4275, -0.0227 * t + 5.3251, 0.1206 * t - 2.5771,
              -0.0670 * t + 0.3703),
        "x": (-0.0193 * t - 0.2592, -0.0665 * t + 0.0008, -0.0004 * t + 0.2125,
              -0.0641 * t - 0.8989, -0.0033 * t + 0.0452),
        "y": (-0.0167 * t - 0.2608, -0.0950 * t + 0.0092, -0.0079 * t + 0.2102,
              -0.0441 * t - 1.6537, -0.0109 * t + 0.0529),
    }  # fmt: skip

    def perez(row, theta, gamma):
        a, b, c, d, e = row
        horizon = 1 + a * math.exp(b / math.cos(theta))
        return horizon * (1 + c * math.exp(d * gamma) + e * math.cos(gamma) ** 2)

    return [
        zenith[k] * perez(rows[k], theta, gamma) / perez(rows[k], 0.0, s) for k in ("Y", "x", "y")
    ]


def to_xyy(rgb):
    """Luminance and chromaticity of linear Rec.709 from its primaries and white."""
    primaries = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
    xyz = np.column_stack([primaries, 1.0 - primaries.sum(axis=1)]).T
    white = np.array([0.3127, 0.3290, 1.0 - 0.3127 - 0.3290]) / 0.3290
    matrix = xyz * np.linalg.solve(xyz, white)
    big_x, big_y, big_z = matrix @ rgb
    return big_y, big_x / (big_x + big_y + big_z), big_y / (big_x + big_y + big_z)


@pytest.mark.parametrize(("turbidity", "elevation_deg"), SKIES)
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.9, 0.3), (1.5, 2.0), (1.2, 3.8)])
def test_sky_is_preethams(turbidity, elevation_deg, place):
    sky = make_sky(turbidity, elevation_deg)
    dirs = directions(np.array([place[0]]), np.array([place[1]]))
    gamma = math.acos(np.clip(dirs[0] @ sky.sun, -1.0, 1.0))
    expected = preetham_xyy(turbidity, math.radians(90.0 - elevation_deg), place[0], gamma)
    np.testing.assert_allclose(to_xyy(sky.sky_radiance(dirs)[0]), expected, rtol=2e-4)


def test_zenith_luminance_by_hand():
    # T = 2, sun 60 degrees from the zenith: chi = (4/9 - 1/60) pi/3 = 0.447968, tan chi = 0.480550,
    # (8.0906 - 4.9710) 0.480550 - 0.4310 + 2.4192 = 3.48732
    assert zenith_luminance(2.0, math.pi / 3.0) == pytest.approx(3.48732, rel=1e-5)


@pytest.mark.parametrize("radius_deg", [0.2665, 2.0, 10.0])
def test_sun_keeps_its_illuminance(radius_deg):
    sky = make_sky(radius_deg=radius_deg)
    n = 400
    alpha = (np.arange(n) + 0.5) * (sky.sun_radius / n)
    facing = np.sum(np.cos(alpha) * np.sin(alpha)) * (sky.sun_radius / n) * 2.0 * math.pi
    np.testing.assert_allclose(
        sky.sun_radiance * facing, sun_illuminance(3.0, math.radians(45.0)), rtol=1e-4
    )


def test_sun_is_red_when_low_and_weaker():
    high, low = (sun_illuminance(3.0, math.radians(90.0 - e)) for e in (90.0, 3.0))
    assert np.all(low < high)
    assert low[0] / low[2] > 3.0 > high[0] / high[2] > 1.0


@pytest.mark.parametrize(("turbidity", "elevation_deg"), SKIES)
@pytest.mark.parametrize("cosine", [False, True])
def test_sky_integral(turbidity, elevation_deg, cosine):
    sky = make_sky(turbidity, elevation_deg)
    n = 1200
    theta = (np.arange(n) + 0.5) * (0.5 * math.pi / n)
    phi = (np.arange(400) + 0.5) * (2.0 * math.pi / 400)
    grid = np.meshgrid(theta, phi, indexing="ij")
    dirs = directions(grid[0].ravel(), grid[1].ravel())
    weight = np.sin(grid[0]) * np.where(cosine, np.cos(grid[0]), 1.0)
    weight *= (0.5 * math.pi / n) * (2.0 * math.pi / 400)
    expected = weight.ravel() @ sky.sky_radiance(dirs)
    np.testing.assert_allclose(sky.sky_integral(cosine), expected, rtol=1e-4)


def test_ground_sends_back_its_albedo_of_the_light():
    sky = make_sky(ground_albedo=(0.5, 0.25, 0.0))
    light = sky.sky_integral(cosine=True) + sky.sun_irradiance()
    down = directions(np.array([2.0, 3.0]), np.array([0.1, 4.0]))
    np.testing.assert_allclose(
        sky.radiance(down) * math.pi, np.tile(light * [0.5, 0.25, 0.0], (2, 1)), rtol=1e-12
    )


def test_constant_radiance():
    environment = kinds.from_table(ConstantEnvironment(radiance=(1.0, 2.0, 3.0)))
    assert environment.radiance(np.eye(3)).tolist() == [[1.0, 2.0, 3.0]] * 3


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_pdf_integrates_to_one(name):
    environment = make_environment(name)
    total = SphereBins(8, 16).integrals(partial(environment.pdf, ANYWHERE), 120).sum()
    assert total == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_sample_and_pdf_agree(name, rng):
    environment = make_environment(name)
    sample = environment.sample(ANYWHERE, rng.random((10_000, 2)))
    dirs, pdf = sample.directions, sample.pdf
    np.testing.assert_allclose(np.linalg.norm(dirs, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(environment.pdf(ANYWHERE, dirs), pdf, rtol=1e-9)
    assert (pdf > 0.0).all()
    np.testing.assert_array_equal(sample.radiance, environment.radiance(dirs))
    assert np.isinf(sample.distances).all()


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.02], ids=["true", "mutant"])
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_samples_follow_the_pdf(name, factor, rng):
    environment = make_environment(name)
    dirs = environment.sample(ANYWHERE, rng.random((N_SAMPLES, 2))).directions
    bins = SphereBins(12, 24)
    expected = bins.integrals(partial(environment.pdf, ANYWHERE), 96) * N_SAMPLES * factor
    p = chi_square_p(bins.counts(dirs), expected)
    assert (p >= sidak(len(ENVIRONMENTS))) == (factor == 1.0), f"p = {p:.3g}"


@pytest.mark.statistical
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_light_by_sampling_is_light_by_quadrature(name, rng):
    environment = make_environment(name)
    sample = environment.sample(ANYWHERE, rng.random((200_000, 2)))
    values = sample.radiance[:, 1] / sample.pdf
    error = values.std() / math.sqrt(len(values))
    expected = SphereBins(8, 16).integrals(lambda d: environment.radiance(d)[:, 1], 120).sum()
    assert abs(values.mean() - expected) < 4.0 * error + 1e-3 * expected
    assert abs(1.02 * values.mean() - expected) > 4.0 * error + 1e-3 * expected


@pytest.mark.parametrize("bright", [(0, 0), (7, 15), (3, 0), (4, 9)])
def test_pdf_is_positive_wherever_there_is_light(bright, rng):
    rgb = np.zeros((8, 16, 3), np.float32)
    rgb[bright] = 1e6
    rgb[5, 5] = 1e-6
    image = LatLong.make(rgb)
    dirs = rng.normal(size=(200_000, 3))
    dirs /= np.linalg.norm(dirs, axis=1)[:, None]
    lit = image.radiance(dirs).max(axis=1) > 0.0
    assert 0.01 < lit.mean() < 0.5
    assert (image.pdf(dirs)[lit] > 0.0).all()


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2048, 8), (16, 16384)])
def test_tables_rise_and_end_at_one(shape):
    rgb = np.full((*shape, 3), 1e-20, np.float32)
    rgb[-1, -1] = 1e20
    image = LatLong.make(rgb)
    for table in (image.marginal[None], image.conditional):
        assert (np.diff(table, axis=1, prepend=np.float32(0.0)) > 0.0).all()
        assert (table[:, -1] == 1.0).all()


def test_pixels_are_where_they_should_be():
    rgb = np.zeros((4, 8, 3), np.float32)
    rgb[1, 5] = (1.0, 2.0, 3.0)  # right of the middle: from +x towards -y
    theta, phi = 1.5 * math.pi / 4.0, -1.5 * math.pi / 4.0
    for turn in (0.0, 90.0, -30.0):
        image = LatLong.make(rgb, rotation_deg=turn, scale=2.0)
        found = image.radiance(directions(np.array([theta]), np.array([phi + math.radians(turn)])))
        np.testing.assert_allclose(found, [[2.0, 4.0, 6.0]], rtol=1e-12)


def test_negative_pixels_are_counted_and_clamped():
    rgb = np.ones((4, 8, 3), np.float32)
    rgb[0, 0] = (-1.0, -1.0, 0.5)
    rgb[2, 3, 1] = -1e-7
    light = ImageLight(LatLong.make(rgb))
    assert light.n_negative == 2
    assert light.image.texels.min() == 0.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_pixels_that_are_no_numbers_are_refused(value):
    rgb = np.ones((4, 8, 3), np.float32)
    rgb[2, 5, 1] = value
    with pytest.raises(ImageError, match=r"map\.exr: G of the pixel in column 5, row 2"):
        LatLong.make(rgb, source="map.exr")


def test_a_black_image_is_refused():
    with pytest.raises(ImageError, match="every pixel is black"):
        LatLong.make(np.zeros((4, 8, 3), np.float32))


def test_buffers_hold_tables_only_for_sampling():
    sizes = [make_environment("image").device_buffer(sampling).size for sampling in (False, True)]
    assert sizes == [3 + 8 * 16 * 3, 3 + 8 * 16 * 3 + 8 + 8 * 16]


@pytest.mark.parametrize(
    ("name", "n_negative"), [("forest", 826), ("studio", None), ("sunrise", None)]
)
def test_real_maps(shared_data, name, n_negative, rng):
    light = kinds.from_table(ImageEnvironment(file=str(shared_data / "env" / f"{name}.exr")))
    assert isinstance(light, ImageLight)
    if n_negative is not None:
        assert light.n_negative == n_negative
    sample = light.sample(ANYWHERE, rng.random((50_000, 2)))
    np.testing.assert_allclose(light.pdf(ANYWHERE, sample.directions), sample.pdf, rtol=1e-6)
    values = sample.radiance[:, 1] / sample.pdf
    height, width, _ = light.image.texels.shape
    band = -np.diff(np.cos(np.linspace(0.0, math.pi, height + 1))) * (2.0 * math.pi / width)
    expected = float(light.image.texels[:, :, 1].sum(axis=1, dtype=np.float64) @ band)
    assert values.mean() == pytest.approx(expected, rel=0.02)
