"""The error of a picture, told from the variance of its pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.image.compare import REL_EPSILON
from furcl.image.size import strips

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
    absolute, relative = _Sums(), _Sums()
    for rows in strips(*mean.shape[:2]):
        squares = variance[rows].astype(np.float64)
        if not np.isfinite(squares).all():
            return None
        absolute.add(squares)
        relative.add(squares / (mean[rows].astype(np.float64) ** 2 + REL_EPSILON))
    rmse = absolute.interval()
    return {
        "rmse": {name: float(np.sqrt(value)) for name, value in rmse.items()},
        "relmse": relative.interval(),
    }


class _Sums:
    """Sums over the squared errors of pixels, strip by strip."""

    def __init__(self) -> None:
        self.n, self.total, self.squares, self.pairs = 0, 0.0, 0.0, 0.0

    def add(self, errors: NDArray[np.float64]) -> None:
        """Add those of the rows of a strip, (rows, W, 3)."""
        flat = errors.mean(axis=2).ravel()
        pairs = flat[: len(flat) // 2 * 2].reshape(-1, 2)
        self.n += len(flat)
        self.total += float(flat.sum())
        self.squares += float(np.sum(flat**2))
        self.pairs += float(np.sum((pairs[:, 0] - pairs[:, 1]) ** 2))

    def interval(self) -> dict[str, Any]:
        """Their mean and its interval."""
        estimate = self.total / self.n
        half = QUANTILE * float(np.sqrt((self.pairs + 2.0 * self.squares) / self.n**2))
        return {"estimate": estimate, "low": max(estimate - half, 0.0), "high": estimate + half}
