"""The kernels' environment against its float64 twin on the host."""

from __future__ import annotations

import numpy as np
import pyopencl as cl
import pytest
from direction_statistics import SphereBins, chi_square_p, sidak
from environments import ENVIRONMENTS, make_environment

from furcl.device import program
from furcl.device.features import Features
from furcl.light.environment import Environment, ImageLight
from furcl.light.latlong import LatLong
from furcl.light.tables import SkyEnvironment

N_SAMPLES = 600_000

LOOKUP = """
__kernel void lookup(__global const float* environment, __global const float* dirs,
                     __global float* radiance, __global float* pdf)
{
    const uint i = get_global_id(0);
    const float3 dir = vload3(i, dirs);
    vstore3(environment_radiance(environment, dir), i, radiance);
#if FURCL_LIGHT_SAMPLING
    pdf[i] = environment_pdf(environment, dir);
#endif
}
"""
SAMPLE = """
__kernel void sample(__global const float* environment, __global const float2* u,
                     __global float* dirs, __global float* pdf)
{
    const uint i = get_global_id(0);
    float density;
    vstore3(environment_sample(environment, u[i], &density), i, dirs);
    pdf[i] = density;
}
"""


def run(device, environment: Environment, kernel: str, values, *, light_sampling: bool = True):
    """Run a kernel of this file over rows of `values`; its two outputs, (n, 3) and (n,)."""
    features = Features(environment=environment.kind, light_sampling=light_sampling)
    text = (
        program.source("light/environment.clh", features)
        + LOOKUP
        + (SAMPLE if light_sampling else "")
    )
    built = cl.Program(device.context, text).build(list(program.OPTIONS))
    flags = cl.mem_flags
    n = len(values)
    inputs = [environment.device_buffer(light_sampling), np.ascontiguousarray(values, np.float32)]
    buffers = [
        cl.Buffer(device.context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=array)
        for array in inputs
    ]
    outputs = [np.zeros((n, 3), np.float32), np.zeros(n, np.float32)]
    buffers += [cl.Buffer(device.context, flags.WRITE_ONLY, array.nbytes) for array in outputs]
    getattr(built, kernel)(device.queue, (n,), None, *buffers)
    for array, buffer in zip(outputs, buffers[2:], strict=True):
        cl.enqueue_copy(device.queue, array, buffer)
    return outputs


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
    pdf = environment.pdf(dirs.astype(np.float64))
    return np.all([np.isclose(environment.pdf(dirs + s), pdf, rtol=1e-6) for s in shifts], axis=0)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_lookup_is_the_hosts(device, name, rng):
    environment = make_environment(name)
    dirs = sphere(rng, 20_000)
    radiance, pdf = run(device, environment, "lookup", dirs)
    assert np.isfinite(radiance).all()
    inside = same_cells(environment, dirs)
    assert inside.mean() > 0.99
    wide = dirs.astype(np.float64)
    expected = environment.radiance(wide)
    scale = expected.max(axis=1, keepdims=True) + 1e-6
    assert np.abs((radiance - expected) / scale)[inside].max() < 1e-4
    np.testing.assert_allclose(pdf[inside], environment.pdf(wide)[inside], rtol=2e-5)


@pytest.mark.parametrize("name", ["constant", "sky", "image"])
def test_lookup_without_light_sampling(device, name, rng):
    environment = make_environment(name)
    dirs = sphere(rng, 500)
    with_tables, _ = run(device, environment, "lookup", dirs)
    without, _ = run(device, environment, "lookup", dirs, light_sampling=False)
    np.testing.assert_allclose(without, with_tables, rtol=1e-6)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_samples_are_the_hosts(device, name, rng):
    environment = make_environment(name)
    u = (rng.integers(0, 1 << 24, (20_000, 2)) / (1 << 24)).astype(np.float32)
    u[:4] = [[0.0, 0.0], [0.0, 1.0 - 2**-24], [1.0 - 2**-24, 0.0], [1.0 - 2**-24, 1.0 - 2**-24]]
    dirs, pdf = run(device, environment, "sample", u)
    expected_dirs, expected_pdf = environment.sample(u.astype(np.float64))
    np.testing.assert_allclose(np.linalg.norm(dirs, axis=1), 1.0, atol=1e-6)
    close = np.linalg.norm(dirs - expected_dirs, axis=1) < 2e-3
    assert close.mean() > 0.9995
    agree = np.isclose(pdf, expected_pdf, rtol=1e-4)
    assert agree.mean() > 0.9995
    assert (pdf > 0.0).all()


@pytest.mark.statistical
@pytest.mark.parametrize("factor", [1.0, 1.02], ids=["true", "mutant"])
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_samples_follow_the_hosts_pdf(device, name, factor, rng):
    environment = make_environment(name)
    u = (rng.integers(0, 1 << 24, (N_SAMPLES, 2)) / (1 << 24)).astype(np.float32)
    dirs, _ = run(device, environment, "sample", u)
    bins = SphereBins(12, 24)
    expected = bins.integrals(environment.pdf, 48) * N_SAMPLES * factor
    p = chi_square_p(bins.counts(dirs.astype(np.float64)), expected)
    assert (p >= sidak(len(ENVIRONMENTS))) == (factor == 1.0), f"p = {p:.3g}"


def test_a_small_sun_keeps_its_power_in_float32(device, rng):
    sky = Environment.from_scene(SkyEnvironment(sun_radius_deg=0.2665, sun_elevation_deg=30.0))
    u = rng.random((200_000, 2)).astype(np.float32)
    dirs, pdf = run(device, sky, "sample", u)
    radiance, again = run(device, sky, "lookup", dirs)
    np.testing.assert_allclose(pdf, again, rtol=1e-6)
    values = radiance[:, 1].astype(np.float64) / pdf
    host_dirs, host_pdf = sky.sample(u.astype(np.float64))
    expected = sky.radiance(host_dirs)[:, 1] / host_pdf
    assert values.mean() == pytest.approx(expected.mean(), rel=2e-4)


def test_a_large_map(device, rng):
    rgb = rng.exponential(size=(512, 1024, 3)).astype(np.float32)
    rgb[100, 300] = 3e4
    light = ImageLight(LatLong.make(rgb, rotation_deg=-33.0))
    u = (rng.integers(0, 1 << 24, (50_000, 2)) / (1 << 24)).astype(np.float32)
    dirs, pdf = run(device, light, "sample", u)
    radiance, again = run(device, light, "lookup", dirs)
    # Rounding moves a sample at a cell's edge to the neighbour: 4e-7 rad against cells of 6e-3.
    assert np.isclose(pdf, again, rtol=1e-4).mean() > 0.998
    values = radiance[:, 1].astype(np.float64) / pdf
    band = -np.diff(np.cos(np.linspace(0.0, np.pi, 513))) * (2.0 * np.pi / 1024)
    expected = float(light.image.texels[:, :, 1].sum(axis=1, dtype=np.float64) @ band)
    error = values.std() / np.sqrt(len(values))
    assert abs(values.mean() - expected) < 4.0 * error + 1e-3 * expected
