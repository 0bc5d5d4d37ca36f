"""The error that a render is to reach."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import RELATIVE_EPSILON
from furcl.errors import SceneError


@dataclass(frozen=True)
class Target:
    """The error of a picture that is enough.

    Attributes
    ----------
    value : float       > 0: root mean squared error of linear radiance, or relMSE
    relative : bool     relMSE, as furcl.image.compare.relmse
    """

    value: float
    relative: bool

    @staticmethod
    def of(rmse: float | None, relmse: float | None) -> Target | None:
        """A target of what users give; None if they give none.

        Raises
        ------
        SceneError      both, or a number that is not above zero
        """
        if rmse is not None and relmse is not None:
            raise SceneError(
                f"target_rmse = {rmse} and target_relmse = {relmse} are two targets; allowed is "
                f"one: leave one out"
            )
        value = rmse if relmse is None else relmse
        if value is None:
            return None
        if not (math.isfinite(value) and value > 0.0):
            name = "target_rmse" if relmse is None else "target_relmse"
            raise SceneError(f"{name} = {value}: allowed is a finite number above 0; give one")
        return Target(float(value), relmse is not None)

    def as_dict(self) -> dict[str, float]:
        """For statistics: {"rmse": value} or {"relmse": value}."""
        return {"relmse" if self.relative else "rmse": self.value}

    def squared_errors(
        self, mean: NDArray[np.float32], variance: NDArray[np.float32]
    ) -> NDArray[np.float64]:
        """What the target limits the mean of, (H, W), from means and their variances (H, W, 3)."""
        errors = variance.astype(np.float64)
        if self.relative:
            errors = errors / (mean.astype(np.float64) ** 2 + RELATIVE_EPSILON)
        return errors.mean(axis=2)

    def needed(self, errors: NDArray[np.float64], samples: NDArray[np.int64]) -> float:
        """Samples a pixel that bring pixels to the target; infinite where errors are unknown."""
        error = float(errors.mean())
        limit = self.value if self.relative else self.value**2
        return float(samples.mean()) * error / limit if math.isfinite(error) else math.inf
