"""Float64 reference of the fibre of Chiang et al. 2016."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.chiang.parameters import ChiangFibre
from furcl.fibre.cylinder.reference import Reference, Shape

Array = NDArray[np.float64]


class _Chiang(Shape):
    orders, residual = 3, True

    def __init__(self, fibre: ChiangFibre) -> None:
        self.eta, self.sigma_a = fibre.eta, fibre.sigma_a
        self.tilt = -np.deg2rad(abs(fibre.alpha_deg))
        m, n = fibre.beta_m, fibre.beta_n
        self._v = (0.726 * m + 0.812 * m**2 + 3.7 * m**20) ** 2
        self._s = 0.626657069 * (0.265 * n + 1.194 * n**2 + 5.372 * n**22)

    def variance(self, p: int) -> float:
        return self._v * (1.0, 0.25, 4.0)[min(p, 2)]

    def _cdf(self, x: Array) -> Array:
        return 1.0 / (1.0 + np.exp(-np.clip(x / self._s, -700.0, 700.0)))

    def azimuth(self, angle: Array) -> Array:
        e = np.exp(-np.minimum(np.abs(angle) / self._s, 700.0))
        within = self._cdf(np.array(np.pi)) - self._cdf(np.array(-np.pi))
        return e / (self._s * (1.0 + e) ** 2) / within

    def draw_turn(self, name: str, rng: np.random.Generator, n: int) -> Array:
        """The inverse of the logistic's CDF between its values at the ends."""
        low, high = self._cdf(np.array(-np.pi)), self._cdf(np.array(np.pi))
        u = rng.uniform(low, high, n)
        return np.clip(-self._s * np.log(1.0 / u - 1.0), -np.pi, np.pi)


REFERENCE = Reference(lambda fibre, residual, profiles: _Chiang(fibre))
evaluate = REFERENCE.evaluate
direction_pdf = REFERENCE.direction_pdf
pdf = REFERENCE.pdf
sample = REFERENCE.sample
attenuation = REFERENCE.attenuation
albedo = REFERENCE.albedo
lobe_shares = REFERENCE.lobe_shares
