"""The film against float64: mean, variance, compensation, and what is not finite."""

import tracemalloc

import numpy as np
import pyopencl as cl
import pytest

from furcl.device import layout, program
from furcl.device.features import Features
from furcl.device.launch import grid, path_defines
from furcl.device.memory import Memory
from furcl.image import size
from furcl.image.size import STRIP_PIXELS
from furcl.rendering.film import Film


def _add(device, memory, film, values, first_sample):
    """Add samples (n, channels, H * W) to a film through the kernel that renders use."""
    n, channels, n_pixels = values.shape
    features = film.features
    names = layout.planes(features)
    wave = np.zeros((), layout.struct_dtype("Wave"))
    wave["width"], wave["height"] = film.width, film.height
    wave["first_sample"] = first_sample
    wave["n_paths"] = n * n_pixels
    wave["n_slots"] = n_slots = layout.whole_blocks(n * n_pixels)
    first = names.index("RADIANCE_X" if channels == 3 else "RADIANCE")
    planes = np.zeros((len(names), n_slots), np.float32)
    planes[first : first + channels, : n * n_pixels] = values.transpose(1, 0, 2).reshape(
        channels, -1
    )
    state = planes.reshape(len(names), -1, layout.STATE_BLOCK).swapaxes(0, 1)
    kernel = cl.Kernel(
        program.build(device, "stages/film.cl", features, path_defines(device)), "add_to_film"
    )
    local = Memory(device)
    kernel(
        device.queue, *grid(n_pixels), local.upload("state", state), film.sums,
        film.n_samples, film.nonfinite, wave,
    )  # fmt: skip
    device.queue.finish()


@pytest.mark.parametrize("channels", [1, 3])
def test_mean_and_variance(device, rng, channels):
    memory = Memory(device)
    film = Film.allocate(memory, 8, 1, Features(channels=channels))
    values = rng.lognormal(0, 2, (50, channels, 8)).astype(np.float32)
    _add(device, memory, film, values[:20], 0)
    _add(device, memory, film, values[20:], 20)
    mean, variance, samples = film.read(memory)
    exact = values.astype(np.float64)
    # Eight pixels in one row: tiles number them in order.
    shape = (1, 8, channels)
    np.testing.assert_allclose(mean[..., :channels], exact.mean(0).T.reshape(shape), rtol=3e-7)
    expected = exact.var(axis=0, ddof=1).T.reshape(shape) / 50
    np.testing.assert_allclose(variance[..., :channels], expected, rtol=2e-5)
    assert np.all(samples == 50)


def test_many_samples_do_not_drift(device, rng):
    """10^5 samples a pixel: a plain float32 sum is off by more than the bound of 1e-5."""
    memory = Memory(device)
    film = Film.allocate(memory, 4, 4, Features(channels=1))
    total, square, plain = np.zeros(16), np.zeros(16), np.zeros(16, np.float32)
    n, block = 100_000, 5_000
    for start in range(0, n, block):
        values = rng.lognormal(3, 1, (block, 1, 16)).astype(np.float32)
        _add(device, memory, film, values, start)
        total += values.astype(np.float64).sum(axis=(0, 1))
        square += (values.astype(np.float64) ** 2).sum(axis=(0, 1))
        for row in values[:, 0]:
            plain += row
    mean, variance, _ = film.read(memory)
    order = [(i % 4) * 4 + i // 4 for i in range(16)]  # tiles run down the columns
    got = mean[..., 0].ravel()[order]
    np.testing.assert_allclose(got, total / n, rtol=2e-7)
    assert np.max(np.abs(plain / n / (total / n) - 1)) > 1e-5
    expected = (square - total**2 / n) / (n - 1) / n
    np.testing.assert_allclose(variance[..., 0].ravel()[order], expected, rtol=1e-4)


def test_nonfinite_samples_are_counted_and_seen(device):
    memory = Memory(device)
    film = Film.allocate(memory, 2, 1, Features(channels=1))
    values = np.array([[[1.0, np.nan]], [[2.0, np.inf]]], np.float32)
    _add(device, memory, film, values, 0)
    assert film.read_nonfinite(memory) == 2
    mean, _, _ = film.read(memory)
    assert mean[0, 0, 0] == 1.5
    assert not np.isfinite(mean[0, 1, 0])


def test_empty_film_is_nan(device):
    memory = Memory(device)
    mean, variance, samples = Film.allocate(memory, 3, 2, Features()).read(memory)
    assert np.isnan(mean).all()
    assert np.isnan(variance).all()
    assert not samples.any()


def test_reading_takes_little_memory(device):
    """By strips: beside what it returns, a few copies of a strip."""
    memory = Memory(device)
    film = Film.allocate(memory, 2048, 2048, Features())
    strip = 8 * 4 * 3 * STRIP_PIXELS  # the sums of its pixels as float64
    tracemalloc.start()
    mean, variance, samples = film.read(memory)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak <= mean.nbytes + variance.nbytes + samples.nbytes + 3 * strip
    # Files are written without a copy of channels.
    assert all(values[..., c].flags.c_contiguous for values in (mean, variance) for c in range(3))


def test_strips_are_read_as_one(device, rng, monkeypatch):
    memory = Memory(device)
    film = Film.allocate(memory, 5, 7, Features())
    values = rng.lognormal(0, 2, (9, 3, 35)).astype(np.float32)
    _add(device, memory, film, values, 0)
    whole = film.read(memory)
    monkeypatch.setattr(size, "STRIP_PIXELS", 10)
    assert [rows.start for rows in size.strips(7, 5)] == [0, 2, 4, 6]
    for one, other in zip(film.read(memory), whole, strict=True):
        assert np.array_equal(one, other)
