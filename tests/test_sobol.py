"""Owen-scrambled Sobol numbers: directions, nets, uniformity and independence, each with mutants.

Statistics are of the numbers in numpy, which the device's are equal to bit by bit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from direction_statistics import chi_square_p, sidak
from kernel_harness import FULL, call
from scipy import stats
from scipy.stats import qmc

from furcl.device import random_numbers
from furcl.device.random_numbers import independent_bits, sobol_bits, sobol_points

LATE = (1 << 20) + 12345
"""A sample beyond those that a scene can ask for: renders that go on may get there."""


def numbers(
    pixels: np.ndarray, n_samples: int, dimension: int = 3, seed: int = 7, first: int = 0
) -> np.ndarray:
    """(pixels, samples, 4) uniform numbers."""
    sample = np.tile(first + np.arange(n_samples), len(pixels))
    bits = random_numbers.sobol_bits(seed, np.repeat(pixels, n_samples), sample, dimension)
    return (bits >> 8).reshape(len(pixels), n_samples, 4) / 2.0**24


# Directions, and the device ----------------------------------------------------------------------


def _scipys_points() -> np.ndarray:
    """The first 2^12 points of four dimensions by scipy, in the order of the index: scipy's are in
    that of its Gray code."""
    points = qmc.Sobol(4, scramble=False, bits=32).random(1 << 12)
    index = np.arange(1 << 12)
    found = np.empty_like(points)
    found[index ^ (index >> 1)] = points
    return found


def test_points_are_those_of_joe_and_kuo():
    assert np.array_equal(sobol_points(np.arange(1 << 12)) / 2.0**32, _scipys_points())


def test_another_polynomial_is_seen(monkeypatch):
    wrong = (*random_numbers.JOE_KUO[:2], (3, 2, (1, 3, 1)))
    monkeypatch.setattr(random_numbers, "JOE_KUO", wrong)
    assert not np.array_equal(sobol_points(np.arange(1 << 12)) / 2.0**32, _scipys_points())


POINTS = """
static float word_of_point(uint i, uint word)
{
    const uint4 bits = sobol_point(0xfedcba98u, i * 2654435761u, i * 40503u * i, i & 15u);
    const uint value = word < 4u ? (word < 2u ? (word == 0u ? bits.x : bits.y)
                                              : (word == 2u ? bits.z : bits.w)) : 0u;
    return convert_float(value >> 8u);
}
"""


def test_device_has_the_points_of_numpy(device):
    """Pixels and samples from all of 32 bits; a float holds the upper 24 bits of a word exactly."""
    i = np.arange(4096, dtype=np.uint32)
    pixel, sample = i * np.uint32(2654435761), i * np.uint32(40503) * i
    assert sample.max() > 0xFFF00000
    expected = np.empty((len(i), 4), np.uint32)
    for dimension in range(16):
        at = (i & 15) == dimension
        expected[at] = sobol_bits(0xFEDCBA98, pixel[at], sample[at], dimension)
    for word in range(4):
        got = call(device, "core/sobol.clh", f"word_of_point((uint)x, {word}u)", i, before=POINTS)
        np.testing.assert_array_equal(got.astype(np.uint32), expected[:, word] >> 8)


@pytest.mark.parametrize("sequence", ["independent", "sobol"])
@pytest.mark.parametrize("dimension", [0, 2, 3, 4, 5, 1_000_002])
def test_sequence_of_a_scene(device, sequence, dimension):
    """Of all dimensions."""
    x = np.arange(512)
    got = call(
        device,
        "core/rng.clh",
        f"uniform4(5u, 3u, (uint)x, {dimension}u).y",
        x,
        features=FULL.with_(sequence=sequence),
    )
    bits = sobol_bits if sequence == "sobol" else independent_bits
    np.testing.assert_array_equal(got * 2.0**24, bits(5, 3, x, dimension)[:, 1] >> 8)


# Nets --------------------------------------------------------------------------------------------


def is_net(points: np.ndarray) -> bool:
    """Whether 2^m points of two dimensions are a (0, m, 2)-net in base 2: one point in every box of
    volume 2^-m whose sides are powers of 1/2 and whose corners are multiples of them."""
    n = len(points)
    m = n.bit_length() - 1
    for k in range(m + 1):
        cell = (points * (1 << k, 1 << (m - k))).astype(int)
        if len(np.unique(cell[:, 0] << (m - k) | cell[:, 1])) < n:
            return False
    return True


def _all_are_nets(first: int) -> bool:
    """Every aligned run of 2^m samples of a few pixels from a multiple of 2^8 on, m = 3 to 8."""
    points = numbers(np.arange(5), 256, first=first)[:, :, :2]
    return all(
        is_net(run) for pixel in points for m in range(3, 9) for run in pixel.reshape(-1, 1 << m, 2)
    )


@pytest.mark.parametrize("first", [0, 256, 1 << 21, (1 << 32) - 256])
def test_first_two_dimensions_are_nets(first):
    assert _all_are_nets(first)


def _scrambled_upwards(x: np.ndarray, key: np.ndarray) -> np.ndarray:
    """A scrambling that lets bits depend on those below them."""
    x = (x ^ x * np.uint32(0x3D20ADEA)) + key
    return x * (key >> np.uint32(16) | np.uint32(1))


def test_scrambling_from_below_makes_no_nets(monkeypatch):
    monkeypatch.setattr(random_numbers, "scrambled", _scrambled_upwards)
    assert not _all_are_nets(0)


# Uniformity --------------------------------------------------------------------------------------

SAMPLES = (0, 1, 2, 63, 1000, LATE, (1 << 32) - 1)
N_PIXELS = 1 << 16


def _least_p(dimension: int) -> float:
    """Least p-value of chi-squares over pixels: of a sample's point in 4^4 cells, and of each of
    its numbers in 256."""
    found = []
    for sample in SAMPLES:
        bits = random_numbers.sobol_bits(7, np.arange(N_PIXELS), sample, dimension)
        cells = [(bits >> 30) @ np.array([64, 16, 4, 1], np.uint32), *(bits >> 24).T]
        expected = np.full(256, N_PIXELS / 256)
        found += [chi_square_p(np.bincount(c, minlength=256), expected) for c in cells]
    return min(found)


DIMENSIONS = (0, 3, 1 << 20)
UNIFORM_LEVEL = sidak(len(DIMENSIONS) * len(SAMPLES) * 5)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_each_sample_is_uniform_over_pixels(dimension):
    assert _least_p(dimension) > UNIFORM_LEVEL


def _unscrambled(x: np.ndarray, key: np.ndarray) -> np.ndarray:
    del key
    return x


def _one_key(seed: int, pixel: np.ndarray, dimension: int) -> np.ndarray:
    """Keys of a few pixels only."""
    return _hash(seed, pixel & np.uint32(255), dimension)


_hash = random_numbers.pixel_hash


@pytest.mark.parametrize(
    ("what", "mutant"), [("scrambled", _unscrambled), ("pixel_hash", _one_key)]
)
def test_too_little_scrambling_is_not_uniform(monkeypatch, what, mutant):
    monkeypatch.setattr(random_numbers, what, mutant)
    assert _least_p(3) < UNIFORM_LEVEL


# Independence ------------------------------------------------------------------------------------

# Estimates of a pixel that differ in what they see of its points: numbers, and single bits.
ESTIMATES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    **{f"number {d}": lambda u, d=d: u[..., d] - 0.5 for d in range(4)},
    **{f"bit {b} of {d}": lambda u, b=b, d=d: (u[..., d] * 2**b % 1.0) - 0.5
       for b in (1, 2, 5) for d in range(4)},
    "disc": lambda u: np.hypot(u[..., 0], u[..., 1]) < 0.8,
    "corner": lambda u: np.prod(u, axis=-1),
}  # fmt: skip

# Another pixel, dimension, seed or part of the samples: (pixels on, dimension, seed, first sample).
OTHERS = {
    "next pixel": (1, 3, 7, 0),
    "second pixel": (2, 3, 7, 0),
    "pixel below": (256, 3, 7, 0),
    "next dimension": (0, 4, 7, 0),
    "next bounce": (0, 7, 7, 0),
    "next seed": (0, 3, 8, 0),
    "seed and pixel": (1, 3, 8, 0),
    "dimension and pixel": (1, 4, 7, 0),
}
FEW = 16
# Differences of scores from normal ones at this size are far below the level.
PIXELS = np.arange(8192)


def _scores(other: str) -> np.ndarray:
    """Correlation of each estimate from 16 samples with each of `other`, in standard errors."""
    ahead, dimension, seed, first = OTHERS[other]
    here = numbers(PIXELS, FEW)
    there = numbers(PIXELS + ahead, FEW, dimension, seed, first)

    def standardised(u: np.ndarray) -> np.ndarray:
        means = np.array([f(u).mean(axis=1) for f in ESTIMATES.values()])
        means -= means.mean(axis=1, keepdims=True)
        return means / means.std(axis=1, keepdims=True)

    return standardised(here) @ standardised(there).T / np.sqrt(len(PIXELS))


SCORE_LIMIT = float(stats.norm.isf(0.5 * sidak(len(OTHERS) * len(ESTIMATES) ** 2)))


@pytest.mark.parametrize("other", OTHERS)
def test_errors_of_pixels_dimensions_and_seeds_are_independent(other):
    assert np.abs(_scores(other)).max() < SCORE_LIMIT


MUTANTS = {
    "pixels in pairs": (
        lambda s, p, d: _hash(s, p >> np.uint32(1) << np.uint32(1), d),
        "next pixel",
    ),
    "one key a pixel": (lambda s, p, d: _hash(s, p, 0 * d), "next dimension"),
    "no seed": (lambda s, p, d: _hash(0 * s, p, d), "next seed"),
    "sums alone": (
        lambda s, p, d: random_numbers.hashed_bits(p + np.uint32(s) + np.uint32(d)),
        "next pixel and seed",
    ),
}


@pytest.mark.parametrize("mutant", ["pixels in pairs", "one key a pixel", "no seed"])
def test_shared_keys_are_seen(monkeypatch, mutant):
    wrong, other = MUTANTS[mutant]
    monkeypatch.setattr(random_numbers, "pixel_hash", wrong)
    assert np.abs(_scores(other)).max() > SCORE_LIMIT


def test_keys_of_sums_are_seen(monkeypatch):
    """A hash of pixel + dimension gives a pixel the next dimension of the pixel before it."""
    wrong, _ = MUTANTS["sums alone"]
    monkeypatch.setattr(random_numbers, "pixel_hash", wrong)
    monkeypatch.setitem(OTHERS, "next pixel and seed", (1, 3, 6, 0))
    assert np.abs(_scores("next pixel and seed")).max() > SCORE_LIMIT


def _padded_variance() -> float:
    """Variance of the mean of (u - 1/2)(v - 1/2) over 16 samples, u and v of two dimensions, over
    that of independent numbers, largest of all pairs of numbers."""
    u, v = (numbers(PIXELS, FEW, dimension) - 0.5 for dimension in (3, 4))
    means = np.einsum("psi,psj->pij", u, v) / FEW
    return float((means.var(axis=0) * FEW * 144.0).max())


# Measured: 1.23, and 1.62 and 9.4 for the mutants. Of a product the coarsest part is 9/16.
PADDED = 1.35


def test_products_of_two_dimensions_are_hardly_worse_than_of_independent_ones():
    assert _padded_variance() < PADDED


@pytest.mark.parametrize("mutant", ["reordered", "scrambled"])
def test_samples_in_one_order_are_worse(monkeypatch, mutant):
    """Mutants: pairs of samples stay together, or all dimensions take points in the same order."""
    plain = random_numbers.scrambled
    wrong = {
        "reordered": lambda sample, key: sample,
        "scrambled": lambda x, key: x if x.max() < FEW else plain(x, key),
    }
    monkeypatch.setattr(random_numbers, mutant, wrong[mutant])
    assert _padded_variance() > PADDED


# What it is for ----------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [16, 24, 64])
@pytest.mark.parametrize("name", ["number 0", "number 3", "disc", "corner"])
def test_errors_are_smaller_than_of_independent_numbers(n, name):
    """By what exact nested scrambling gives, drawn at random level by level, within 10 %; measured:
    0.97 to 1.06 of its variance. Independent numbers have 4.8 to 4280 times as much."""
    pixels = np.arange(4096)
    estimate = ESTIMATES[name]
    exact = estimate(_exactly_scrambled(n, len(pixels))).mean(axis=1).var()
    independent = independent_bits(7, np.repeat(pixels, n), np.tile(np.arange(n), len(pixels)), 3)
    other = (independent >> 8).reshape(-1, n, 4) / 2.0**24
    assert estimate(numbers(pixels, n)).mean(axis=1).var() == pytest.approx(exact, rel=0.1)
    assert estimate(other).mean(axis=1).var() > 4.0 * exact


def _exactly_scrambled(n: int, n_pixels: int, levels: int = 14) -> np.ndarray:
    """(pixels, n, 4) the first Sobol points, a random flip for every bit and all bits above it."""
    rng = np.random.default_rng(3)
    words = sobol_points(np.arange(n))
    found = np.zeros((n_pixels, n, 4))
    for d in range(4):
        for level in range(levels):
            flips = rng.integers(0, 2, (n_pixels, 1 << level))
            above = words[:, d].astype(np.int64) >> (32 - level)
            bit = words[:, d] >> (31 - level) & 1
            found[:, :, d] += (bit ^ flips[:, above]) * 0.5 ** (level + 1)
    return found + rng.random(found.shape) * 0.5**levels
