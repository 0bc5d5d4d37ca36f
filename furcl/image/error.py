"""The error of a picture, told from the variance of its pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.image.compare import REL_EPSILON

#: Quantile of the normal distribution: intervals of 95 %.
QUANTILE = 1.96


def estimated_errors(
    mean: NDArray[np.float32], variance: NDArray[np.float32]
) -> dict[str, dict[str, float]] | None:
    """RMSE and relMSE of a picture against the truth, which is not known, with 95 % intervals.

    The mean of the variances of the pixels' means is the expected squared error, if pixels are
    independent and unbiased. The intervals hold two things: that the variances are estimates, whose
    own variance pairs of neighbours tell (too large, by the differences between neighbours), and
    that the error of this one picture is not the expected one (normal errors, channels fully
    correlated: too large as well). Where samples of a pixel are spread better than independent
    ones, the estimate is an upper bound. tests/test_target.py has the coverage.

    Parameters
    ----------
    mean, variance : (H, W, 3)      of each pixel; variance of the mean

    Returns
    -------
    {"rmse": {estimate, low, high}, "relmse": the same}, or None if a pixel's variance is unknown
    """
    squares = variance.astype(np.float64)
    if not np.isfinite(squares).all():
        return None
    relative = squares / (mean.astype(np.float64) ** 2 + REL_EPSILON)
    rmse = _interval(squares.mean(axis=2).ravel())
    return {
        "rmse": {name: float(np.sqrt(value)) for name, value in rmse.items()},
        "relmse": _interval(relative.mean(axis=2).ravel()),
    }


def _interval(errors: NDArray[np.float64]) -> dict[str, Any]:
    """Mean of the squared errors of pixels and its interval."""
    n, estimate = errors.size, float(errors.mean())
    pairs = errors[: n - n % 2].reshape(-1, 2)
    of_estimate = float(np.sum((pairs[:, 0] - pairs[:, 1]) ** 2)) / n**2
    of_picture = 2.0 * float(np.sum(errors**2)) / n**2
    half = QUANTILE * float(np.sqrt(of_estimate + of_picture))
    return {"estimate": estimate, "low": max(estimate - half, 0.0), "high": estimate + half}
