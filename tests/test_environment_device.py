"""The kernels' environments against their float64 twins on the host."""

from __future__ import annotations

from functools import partial

import light_kernels
import numpy as np
import pytest
from direction_statistics import SphereBins, chi_square_p, sidak
from environments import ANYWHERE, ENVIRONMENTS, make_environment

from furcl.light import kinds
from furcl.light.image import ImageLight
from furcl.light.latlong import LatLong
from furcl.light.sky import SkyEnvironment

N_SAMPLES = 600_000


def sphere(rng, n):
    """Unit float32 directions, the axes and near-axis ones among them."""
    dirs = rng.normal(size=(n, 3))
    dirs /= np.linalg.norm(dirs, axis=1)[:, None]
    special = np.concatenate([np.eye(3), -np.eye(3)])
    tilted = special + 1e-4 * dirs[: len(special)]
    tilted /= np.linalg.norm(tilted, axis=1)[:, None]
    return np.concatenate([special, tilted, dirs]).astype(np.float32)


def same_cells(environment, dirs):
    """Directions whose float32 rounding cannot move them over an edge of the density."""
    shifts = np.random.default_rng(0).normal(size=(8, *dirs.shape)) * 1e-6
    pdf = environment.pdf(ANYWHERE, dirs.astype(np.float64))
    moved = [environment.pdf(ANYWHERE, dirs + shift) for shift in shifts]
    return np.all([np.isclose(other, pdf, rtol=1e-6) for other in moved], axis=0)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_lookup_is_the_hosts(device, name, rng):
    environment = make_environment(name)
    dirs = sphere(rng, 20_000)
    radiance, pdf = light_kernels.lookup(device, environment, ANYWHERE, dirs)
    assert np.isfinite(radiance).all()
    inside = same_cells(environment, dirs)
    assert inside.mean() > 0.99
    wide = dirs.astype(np.float64)
    expected = environment.radiance(wide)
    scale = expected.max(axis=1, keepdims=True) + 1e-6
    assert np.abs((radiance - expected) / scale)[inside].max() < 1e-4
    np.testing.assert_allclose(pdf[inside], environment.pdf(ANYWHERE, wide)[inside], rtol=2e-5)


@pytest.mark.parametrize("name", ["constant", "sky", "image"])
def test_lookup_without_light_sampling(device, name, rng):
    environment = make_environment(name)
    dirs = sphere(rng, 500)
    with_tables, _ = light_kernels.lookup(device, environment, ANYWHERE, dirs)
    without, _ = light_kernels.lookup(device, environment, ANYWHERE, dirs, light_sampling=False)
    np.testing.assert_allclose(without, with_tables, rtol=1e-6)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_samples_are_the_hosts(device, name, rng):
    environment = make_environment(name)
    u = (rng.integers(0, 1 << 24, (20_000, 2)) / (1 << 24)).astype(np.float32)
    u[:4] = [[0.0, 0.0], [0.0, 1.0 - 2**-24], [1.0 - 2**-24, 0.0], [1.0 - 2**-24, 1.0 - 2**-24]]
    dirs, distances, radiance, pdf = light_kernels.sample(device, environment, ANYWHERE, u)
    expected_dirs, _, _, expected_pdf = environment.sample(ANYWHERE, u.astype(np.float64))
    np.testing.assert_allclose(np.linalg.norm(dirs, axis=1), 1.0, atol=1e-6)
    close = np.linalg.norm(dirs - expected_dirs, axis=1) < 2e-3
    assert close.mean() > 0.9995
    agree = np.isclose(pdf, expected_pdf, rtol=1e-4)
    assert agree.mean() > 0.9995
    assert (pdf > 0.0).all()
    assert np.isinf(distances).all()
    np.testing.assert_array_equal(
        radiance, light_kernels.lookup(device, environment, ANYWHERE, dirs).radiance
    )


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.02], ids=["true", "mutant"])
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_samples_follow_the_hosts_pdf(device, name, factor, rng):
    environment = make_environment(name)
    u = (rng.integers(0, 1 << 24, (N_SAMPLES, 2)) / (1 << 24)).astype(np.float32)
    dirs = light_kernels.sample(device, environment, ANYWHERE, u).directions
    bins = SphereBins(12, 24)
    expected = bins.integrals(partial(environment.pdf, ANYWHERE), 96) * N_SAMPLES * factor
    p = chi_square_p(bins.counts(dirs.astype(np.float64)), expected)
    assert (p >= sidak(len(ENVIRONMENTS))) == (factor == 1.0), f"p = {p:.3g}"


def test_a_small_sun_keeps_its_power_in_float32(device, rng):
    sky = kinds.from_table(SkyEnvironment(sun_radius_deg=0.2665, sun_elevation_deg=30.0))
    u = rng.random((200_000, 2)).astype(np.float32)
    dirs, _, _, pdf = light_kernels.sample(device, sky, ANYWHERE, u)
    radiance, again = light_kernels.lookup(device, sky, ANYWHERE, dirs)
    np.testing.assert_allclose(pdf, again, rtol=1e-6)
    values = radiance[:, 1].astype(np.float64) / pdf
    host = sky.sample(ANYWHERE, u.astype(np.float64))
    expected = host.radiance[:, 1] / host.pdf
    assert values.mean() == pytest.approx(expected.mean(), rel=2e-4)


def test_a_large_map(device, rng):
    rgb = rng.exponential(size=(512, 1024, 3)).astype(np.float32)
    rgb[100, 300] = 3e4
    light = ImageLight(LatLong.make(rgb, rotation_deg=-33.0))
    u = (rng.integers(0, 1 << 24, (50_000, 2)) / (1 << 24)).astype(np.float32)
    dirs, _, _, pdf = light_kernels.sample(device, light, ANYWHERE, u)
    radiance, again = light_kernels.lookup(device, light, ANYWHERE, dirs)
    # Rounding moves a sample at a cell's edge to the neighbour: 4e-7 rad against cells of 6e-3.
    assert np.isclose(pdf, again, rtol=1e-4).mean() > 0.998
    values = radiance[:, 1].astype(np.float64) / pdf
    band = -np.diff(np.cos(np.linspace(0.0, np.pi, 513))) * (2.0 * np.pi / 1024)
    expected = float(light.image.texels[:, :, 1].sum(axis=1, dtype=np.float64) @ band)
    error = values.std() / np.sqrt(len(values))
    assert abs(values.mean() - expected) < 4.0 * error + 1e-3 * expected
