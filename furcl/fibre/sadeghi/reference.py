"""Float64 reference of the fibre of Sadeghi et al. 2010, with the sampling of Ou et al. 2012."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.closed.reference import LEAST_COS, Closed, ClosedReference
from furcl.fibre.sadeghi.parameters import SadeghiFibre

Array = NDArray[np.float64]

LIMIT = np.pi / 2 - LEAST_COS


class _Sadeghi(Closed):
    names = ("R", "TT", "TRT", "glint")

    def __init__(self, fibre: SadeghiFibre) -> None:
        self._height = {
            "R": np.array(fibre.intensity_r),
            "TT": np.array(fibre.intensity_tt),
            "TRT": np.array(fibre.intensity_trt),
            "glint": fibre.glint * np.array(fibre.intensity_trt),
        }
        rad = np.deg2rad
        trt = (rad(fibre.alpha_trt_deg), rad(fibre.beta_trt_deg))
        self._along = {
            "R": (rad(fibre.alpha_r_deg), rad(fibre.beta_r_deg)),
            "TT": (rad(fibre.alpha_tt_deg), rad(fibre.beta_tt_deg)),
            "TRT": trt,
            "glint": trt,
        }
        self._around = {
            "TT": (np.pi, rad(fibre.gamma_tt_deg)),
            "glint": (rad(fibre.glint_deg), rad(fibre.gamma_glint_deg)),
        }
        if fibre.normalise:
            theta = np.deg2rad(np.linspace(-89.0, 89.0, 179))
            largest = np.sum([self.albedo(name, theta) for name in self.names], axis=0).max()
            if largest > 0.0:
                self._height = {name: h / largest for name, h in self._height.items()}

    def energy(self, name: str, theta: Array) -> Array:
        """The integral over theta_h and phi of the bells, as if they ended nowhere."""
        beta = self._along[name][1]
        if name not in self._around:
            of_bells = 4.0 * np.sqrt(2.0 * np.pi) * beta
        else:
            of_bells = (1.0 if name == "TT" else 2.0) * 2.0 * np.pi * beta * self._around[name][1]
        return np.multiply.outer(np.ones_like(theta), of_bells * self._height[name])

    def _azimuth(self, name: str, phi: Array) -> Array:
        size = np.abs(phi - 2.0 * np.pi * np.rint(phi / (2.0 * np.pi)))
        if name not in self._around:
            return np.cos(size / 2.0)
        centre, gamma = self._around[name]
        return np.exp(-0.5 * ((size - centre) / gamma) ** 2)

    def value(self, name: str, theta: Array, theta_o: Array, phi: Array) -> Array:
        alpha, beta = self._along[name]
        x = ((theta_o + theta) / 2.0 - alpha) / beta
        cos_sq = np.maximum(np.cos((theta_o - theta) / 2.0), LEAST_COS) ** 2
        f = np.exp(-0.5 * x**2) * self._azimuth(name, phi) * np.cos(theta_o) / cos_sq
        return f[..., None] * self._height[name]

    def _ends(self, name: str, theta: Array) -> tuple[Array, Array]:
        alpha, beta = self._along[name]
        return (
            np.arctan((theta / 2.0 - np.pi / 4 - alpha) / beta),
            np.arctan((theta / 2.0 + np.pi / 4 - alpha) / beta),
        )

    def density(
        self, name: str, theta: Array, theta_o: Array, phi: Array, by_attenuation: bool
    ) -> Array:
        alpha, beta = self._along[name]
        low, high = self._ends(name, theta)
        x = (theta_o + theta) / 2.0 - alpha
        cos = np.maximum(np.cos(theta_o), LEAST_COS)
        along = beta / (x**2 + beta**2) / (2.0 * (high - low) * cos)
        if name not in self._around:
            return along * self._azimuth(name, phi) / 4.0
        centre, gamma = self._around[name]
        size = np.abs(phi - 2.0 * np.pi * np.rint(phi / (2.0 * np.pi)))
        turn = np.arctan((np.pi - centre) / gamma) + np.arctan(centre / gamma)
        return along * gamma / (2.0 * turn * ((size - centre) ** 2 + gamma**2))

    def draw(
        self, name: str, theta: Array, rng: np.random.Generator, by_attenuation: bool
    ) -> tuple[Array, Array]:
        n = len(theta)
        alpha, beta = self._along[name]
        theta_o = 2.0 * (beta * np.tan(rng.uniform(*self._ends(name, theta))) + alpha) - theta
        theta_o = np.clip(theta_o, -LIMIT, LIMIT)
        if name not in self._around:
            return theta_o, 2.0 * np.arcsin(rng.uniform(-1.0, 1.0, n))
        centre, gamma = self._around[name]
        ends = -np.arctan(centre / gamma), np.arctan((np.pi - centre) / gamma)
        size = centre + gamma * np.tan(rng.uniform(*ends, n))
        return theta_o, np.where(rng.random(n) < 0.5, -size, size)

    def albedo(self, name: str, theta: Array) -> Array:
        """Gauss-Legendre: over the lobe along the fibre, in pieces around it."""
        alpha, beta = self._along[name]
        x, w = np.polynomial.legendre.leggauss(200)
        low = np.maximum(-np.pi / 2, 2.0 * (alpha - 9.0 * beta) - theta)[..., None]
        high = np.minimum(np.pi / 2, 2.0 * (alpha + 9.0 * beta) - theta)[..., None]
        half = np.maximum(high - low, 0.0) / 2.0
        theta_o = (low + high) / 2.0 + half * x
        # At an azimuth where the lobe is 1.
        peak = self._around[name][0] if name in self._around else 0.0
        f = self.value(name, theta[..., None], theta_o, np.array(peak))
        along = np.einsum("...n,...nc->...c", half * w * np.cos(theta_o), f)
        pieces = np.linspace(0.0, np.pi, 41)
        phi = (pieces[:-1, None] + pieces[1:, None] + np.pi / 40 * x) / 2.0
        around = 2.0 * (np.pi / 80) * (self._azimuth(name, phi) * w).sum()
        return along * around


REFERENCE = ClosedReference(_Sadeghi)
evaluate = REFERENCE.evaluate
direction_pdf = REFERENCE.direction_pdf
pdf = REFERENCE.pdf
sample = REFERENCE.sample
attenuation = REFERENCE.attenuation
albedo = REFERENCE.albedo
lobe_shares = REFERENCE.lobe_shares
