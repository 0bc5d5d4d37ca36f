"""Means, intervals and comparisons of repeated renders.

All intervals are Student t intervals over independent runs. Ratios and slopes are taken run by run,
in logarithms: the variants of one run were rendered side by side, so what slowed the machine then
slowed them all.
"""

from __future__ import annotations

import math
import statistics
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Estimate:
    """A mean over n runs with its interval; low and high are NaN for a single run.

    `median` is that of the runs, which single bright samples do not move; NaN where it is not told.
    """

    mean: float
    low: float
    high: float
    n: int
    median: float = math.nan

    def contains(self, value: float) -> bool:
        """Whether the interval holds a value."""
        return self.low <= value <= self.high

    def widened(self, half: float) -> Estimate:
        """With an independent error of that half width added in squares."""
        below, above = (math.hypot(self.mean - end, half) for end in (self.low, self.high))
        return replace(self, low=self.mean - below, high=self.mean + above)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON, None for NaN; without a median that is not told."""
        values = {k: None if v != v else v for k, v in asdict(self).items()}
        return {k: v for k, v in values.items() if k != "median" or v is not None}


def mean_interval(values: ArrayLike, confidence: float = CONFIDENCE) -> Estimate:
    """Mean of independent values and its t interval, and their median."""
    x = np.asarray(values, np.float64)
    mean, median = float(x.mean()), float(statistics.median(x.tolist()))
    if x.size < 2:
        return Estimate(mean, np.nan, np.nan, int(x.size), median)
    from scipy.stats import t

    half = float(t.ppf(0.5 + 0.5 * confidence, x.size - 1) * x.std(ddof=1) / np.sqrt(x.size))
    return Estimate(mean, mean - half, mean + half, int(x.size), median)


def ratio_interval(values: ArrayLike, confidence: float = CONFIDENCE) -> Estimate:
    """Geometric mean of positive values and the t interval of their logarithms."""
    e = mean_interval(np.log(np.asarray(values, np.float64)), confidence)
    mean, low, high, median = (float(np.exp(x)) for x in (e.mean, e.low, e.high, e.median))
    return Estimate(mean, low, high, e.n, median)


def slope(spp: ArrayLike, error: ArrayLike, confidence: float = CONFIDENCE) -> Estimate:
    """Exponent of the error as a power of the number of samples: -1/2 for independent samples.

    Parameters
    ----------
    spp : (k,)              at least two
    error : (runs, k)       > 0; a line is fitted to each run, the interval is over the runs
    """
    x = np.log(np.asarray(spp, np.float64))
    y = np.log(np.asarray(error, np.float64))
    x = x - x.mean()
    return mean_interval((y - y.mean(axis=1, keepdims=True)) @ x / (x @ x), confidence)


def interpolate(at: float, x: ArrayLike, y: ArrayLike, power: float) -> tuple[float, bool]:
    """Value of a curve, linear in log y over log x between its points.

    Beyond the first and last point it goes on as x to the `power`; the second value returned says
    whether that was needed.
    """
    order = np.argsort(x)
    log_x = np.log(np.asarray(x, np.float64)[order])
    log_y = np.log(np.asarray(y, np.float64)[order])
    target = np.log(at)
    value = np.interp(target, log_x, log_y)
    beyond = min(target - log_x[0], 0.0) + max(target - log_x[-1], 0.0)
    return float(np.exp(value + power * beyond)), bool(beyond != 0.0)


@dataclass(frozen=True, eq=False)
class Curve:
    """What one variant did in every run: (runs, k) arrays over the k sample counts `spp`."""

    spp: NDArray[np.float64]
    seconds: NDArray[np.float64]
    rmse: NDArray[np.float64]
    rays: NDArray[np.float64]

    @property
    def resolved(self) -> bool:
        """Whether there are runs, and every error of them is above that of the reference."""
        return bool(self.rmse.size and np.all(self.rmse > 0.0))


def compare_curves(curve: Curve, baseline: Curve) -> dict[str, Any]:
    """A variant against a baseline rendered in the same runs; both are `resolved`.

    Efficiency is 1 / (MSE x seconds), efficiency_rays 1 / (MSE x rays), each over that of the
    baseline.

    Returns
    -------
    dict with, for every sample count of the variant,
        same_spp        rmse_ratio, seconds_ratio, efficiency and efficiency_rays at the same number
                        of samples
        equal_time      rmse_ratio when the baseline renders as long, its rmse and its spp then,
                        `extrapolated` if that is beyond what was measured
        equal_error     speed_up: the baseline's time to the same RMSE over the variant's
    and efficiency and efficiency_rays over all counts; ratios are Estimates as dicts
    """
    same, equal_time, equal_error = [], [], []
    n_runs = len(curve.rmse)
    for k, spp in enumerate(curve.spp.tolist()):
        at_time, at_error, counts = [], [], []
        beyond_time = beyond_error = False
        for r in range(n_runs):
            seconds, rmse = curve.seconds[r, k], curve.rmse[r, k]
            base_seconds, base_rmse = baseline.seconds[r], baseline.rmse[r]
            value, beyond = interpolate(seconds, base_seconds, base_rmse, -0.5)
            at_time.append(value)
            beyond_time |= beyond
            counts.append(interpolate(seconds, base_seconds, baseline.spp, 1.0)[0])
            value, beyond = interpolate(rmse, base_rmse, base_seconds, -2.0)
            at_error.append(value)
            beyond_error |= beyond
        if spp in baseline.spp:
            j = int(np.flatnonzero(baseline.spp == spp)[0])
            same.append(
                {
                    "spp": int(spp),
                    "rmse_ratio": _ratio(curve.rmse[:, k], baseline.rmse[:, j]),
                    "seconds_ratio": _ratio(curve.seconds[:, k], baseline.seconds[:, j]),
                    "efficiency": _gain(curve, baseline, "seconds", [k], [j]),
                    "efficiency_rays": _gain(curve, baseline, "rays", [k], [j]),
                }
            )
        equal_time.append(
            {
                "spp": int(spp),
                "seconds": float(curve.seconds[:, k].mean()),
                "rmse": float(curve.rmse[:, k].mean()),
                "baseline_rmse": ratio_interval(at_time).mean,
                "baseline_spp": ratio_interval(counts).mean,
                "rmse_ratio": _ratio(curve.rmse[:, k], at_time),
                "extrapolated": beyond_time,
            }
        )
        equal_error.append(
            {
                "spp": int(spp),
                "rmse": float(curve.rmse[:, k].mean()),
                "speed_up": _ratio(at_error, curve.seconds[:, k]),
                "extrapolated": beyond_error,
            }
        )
    common = [n for n in curve.spp if n in baseline.spp]
    places = [[int(np.flatnonzero(c.spp == n)[0]) for n in common] for c in (curve, baseline)]
    return {
        "same_spp": same,
        "equal_time": equal_time,
        "equal_error": equal_error,
        "efficiency": _gain(curve, baseline, "seconds", *places) if common else None,
        "efficiency_rays": _gain(curve, baseline, "rays", *places) if common else None,
    }


def _gain(
    curve: Curve, baseline: Curve, cost: str, places: list[int], base_places: list[int]
) -> dict[str, Any]:
    """MSE x cost of the baseline over that of a variant, the mean over some sample counts."""
    mine = np.log(curve.rmse**2 * getattr(curve, cost))[:, places]
    base = np.log(baseline.rmse**2 * getattr(baseline, cost))[:, base_places]
    return ratio_interval(np.exp((base - mine).mean(axis=1))).as_dict()


def _ratio(values: ArrayLike, over: ArrayLike) -> dict[str, Any]:
    return ratio_interval(np.asarray(values) / np.asarray(over)).as_dict()
