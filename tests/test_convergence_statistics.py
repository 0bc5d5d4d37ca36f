"""Means, intervals and comparisons of repeated renders, by hand and on simulated ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from furcl.bench.convergence_statistics import (
    Curve,
    compare_curves,
    interpolate,
    mean_interval,
    ratio_interval,
    slope,
)

SPP = (4, 8, 16, 32)
# Of each interval that a test looks into.
CONFIDENCE = 0.999


def test_mean_interval_of_five_values_by_hand():
    found = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.7764451 * math.sqrt(2.5 / 5.0)
    assert found.mean == 3.0
    assert (found.low, found.high) == pytest.approx((3.0 - half, 3.0 + half), abs=1e-6)
    single = mean_interval([2.0])
    assert single.mean == 2.0
    assert single.as_dict() == {"mean": 2.0, "low": None, "high": None, "n": 1, "median": 2.0}


def test_the_median_of_runs_stays_where_one_bright_run_moves_the_mean():
    runs = [1.0, 1.1, 0.9, 1.0, 50.0]
    assert mean_interval(runs).mean > 10.0
    assert mean_interval(runs).median == 1.0
    assert ratio_interval(runs).median == pytest.approx(1.0)
    assert mean_interval(runs).widened(0.1).median == 1.0


def test_intervals_cover_the_truth_as_often_as_they_say(rng):
    """3000 intervals of 5 log-normal values; binomial bounds at alpha 1e-4."""
    n = 3000
    values = np.exp(rng.normal(0.3, 0.2, (n, 5)))
    covered = sum(ratio_interval(row).contains(math.exp(0.3)) for row in values)
    assert abs(covered - 0.95 * n) < 3.9 * math.sqrt(n * 0.95 * 0.05)


def noisy_errors(rng: np.random.Generator, bias: float) -> np.ndarray:
    """(5, 4) RMSE of Monte Carlo over SPP, 1 % noise, with a bias added in squares."""
    return np.sqrt(1.0 / np.array(SPP) + bias**2) * np.exp(rng.normal(0.0, 0.01, (5, 4)))


def test_slope_is_half_for_monte_carlo_and_less_with_a_bias(rng):
    assert slope(SPP, noisy_errors(rng, 0.0), CONFIDENCE).contains(-0.5)
    assert not slope(SPP, noisy_errors(rng, 0.2), CONFIDENCE).contains(-0.5)
    exact = slope(SPP, np.tile(np.array(SPP, float) ** -0.3, (3, 1)))
    assert exact.mean == pytest.approx(-0.3, abs=1e-12)


@pytest.mark.parametrize(
    ("at", "beyond"), [(3.0, False), (1.0, False), (16.0, False), (0.5, True), (40.0, True)]
)
def test_interpolation_follows_power_laws(at, beyond):
    x = np.array([4.0, 1.0, 16.0])
    value, extrapolated = interpolate(at, x, 7.0 * x**-0.5, -0.5)
    assert value == pytest.approx(7.0 * at**-0.5, rel=1e-12)
    assert extrapolated == beyond


def test_a_sampler_of_half_the_variance_is_twice_as_fast():
    spp = np.array(SPP, np.float64)
    seconds = np.array([[1.0], [1.3]]) * spp
    baseline = Curve(spp, seconds, np.tile(spp**-0.5, (2, 1)), 10.0 * seconds)
    better = Curve(spp, seconds, np.tile((2.0 * spp) ** -0.5, (2, 1)), 4.0 * seconds)
    found = compare_curves(better, baseline)
    assert found["efficiency"]["mean"] == pytest.approx(2.0)
    assert found["efficiency_rays"]["mean"] == pytest.approx(5.0)
    for row in found["same_spp"]:
        assert row["efficiency"]["mean"] == pytest.approx(2.0)
        assert row["efficiency_rays"]["mean"] == pytest.approx(5.0)
    for row in found["equal_error"]:
        assert row["speed_up"]["mean"] == pytest.approx(2.0)
    for row in found["equal_time"] + found["same_spp"]:
        assert row["rmse_ratio"]["mean"] == pytest.approx(math.sqrt(0.5))
    assert [row["extrapolated"] for row in found["equal_error"]] == [False] * 3 + [True]
    assert found["equal_time"][1]["baseline_spp"] == pytest.approx(SPP[1])


def test_a_slower_sampler_is_compared_with_more_samples_of_the_other():
    spp = np.array(SPP, np.float64)
    baseline = Curve(spp, spp[None], spp[None] ** -0.5, spp[None])
    slow = Curve(spp, 2.0 * spp[None], spp[None] ** -0.5, spp[None])
    row = compare_curves(slow, baseline)["equal_time"][0]
    assert row["baseline_spp"] == pytest.approx(2 * SPP[0])
    assert row["rmse_ratio"]["mean"] == pytest.approx(math.sqrt(2.0))


def test_efficiency_of_three_runs_by_hand():
    """MSE x cost of the baseline over the variant's: 6, 8 and 9 in the runs, by rays half of it."""
    spp = np.array([16.0])
    baseline = Curve(spp, np.full((3, 1), 2.0), np.array([[3.0], [4.0], [3.0]]), np.ones((3, 1)))
    seconds, rmse = np.array([[3.0], [1.0], [2.0]]), np.array([[1.0], [2.0], [1.0]])
    found = compare_curves(Curve(spp, seconds, rmse, seconds), baseline)
    logs = np.log([6.0, 8.0, 9.0])
    half = 4.3026527 * logs.std(ddof=1) / math.sqrt(3.0)
    for key, factor in (("efficiency", 1.0), ("efficiency_rays", 0.5)):
        for estimate in (found[key], found["same_spp"][0][key]):
            assert estimate["mean"] == pytest.approx(factor * math.exp(logs.mean()))
            assert estimate["low"] == pytest.approx(factor * math.exp(logs.mean() - half))
            assert estimate["high"] == pytest.approx(factor * math.exp(logs.mean() + half))
            assert estimate["n"] == 3


def simulated(
    rng: np.random.Generator, slowed: np.ndarray, mse: float, seconds: float, rays: float
) -> Curve:
    """Five runs over SPP: MSE of 2000 values a picture, times with 3 % noise on a machine that is
    `slowed` (5, 1) in each run."""
    spp = np.array(SPP, np.float64)
    noise = np.exp(rng.normal(0.0, 0.03, (5, len(SPP))))
    squares = mse / spp * rng.chisquare(2000, noise.shape) / 2000
    return Curve(spp, seconds * spp * slowed * noise, np.sqrt(squares), np.tile(rays * spp, (5, 1)))


@pytest.mark.statistical
@pytest.mark.parametrize("off", [1.0, 1.15])
def test_intervals_cover_a_known_efficiency(rng, off):
    """1000 simulated comparisons, true efficiency 2.5 by time and 5 by rays; binomial bounds at
    alpha 1e-4. An efficiency 15 % off, the mutant, is covered far less often."""
    n = 1000
    covered = {"efficiency": 0, "efficiency_rays": 0}
    for _ in range(n):
        slowed = np.exp(rng.normal(0.0, 0.3, (5, 1)))
        baseline = simulated(rng, slowed, 1.0, 1.0, 3.0)
        found = compare_curves(simulated(rng, slowed, 0.2, 2.0, 3.0), baseline)
        for key, truth in (("efficiency", 2.5), ("efficiency_rays", 5.0)):
            covered[key] += found[key]["low"] < off * truth < found[key]["high"]
    bound = 3.9 * math.sqrt(n * 0.95 * 0.05)
    for count in covered.values():
        assert (abs(count - 0.95 * n) < bound) == (off == 1.0)


def test_an_error_below_that_of_the_reference_is_not_resolved():
    one = np.ones((2, 1))
    assert Curve(np.array([8.0]), one, one, one).resolved
    assert not Curve(np.array([8.0]), one, one * [[0.0], [1.0]], one).resolved
    assert not Curve(np.array([8.0]), one[:0], one[:0], one[:0]).resolved
