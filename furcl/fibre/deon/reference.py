"""Float64 reference of the fibre of d'Eon et al. 2011."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.cylinder.reference import Reference, Shape
from furcl.fibre.deon.parameters import DEonFibre
from furcl.fibre.double_cylinder.reference.angles import MIN_BETA, wrapped_gaussian

Array = NDArray[np.float64]


class _DEon(Shape):
    def __init__(self, fibre: DEonFibre, residual: bool) -> None:
        self.eta, self.sigma_a = fibre.eta, fibre.sigma_a
        self.orders, self.residual = fibre.orders, residual
        self.tilt = -np.deg2rad(abs(fibre.alpha_deg))
        self._m, self._n = np.deg2rad(fibre.beta_m_deg), np.deg2rad(fibre.beta_n_deg)
        self._cone = fibre.cone

    def variance(self, p: int) -> float:
        return (self._m * (1.0, 0.5, 2.0)[min(p, 2)]) ** 2

    def azimuth(self, angle: Array) -> Array:
        return wrapped_gaussian(angle, self._n)

    def draw_turn(self, name: str, rng: np.random.Generator, n: int) -> Array:
        return self._n * rng.standard_normal(n)

    def centre(self, name: str, theta: Array, phi: Array) -> tuple[Array, Array]:
        """Of the cone the mirror direction of a normal at azimuth phi / 2, turned by the tilt."""
        if name != "R" or not self._cone:
            return super().centre(name, theta, phi)
        half, a = 0.5 * (phi - 2.0 * np.pi * np.rint(phi / (2.0 * np.pi))), self.tilt
        along = np.cos(a) * np.cos(half) * np.cos(theta) + np.sin(a) * np.sin(theta)
        mirrored = 2.0 * np.sin(a) * along - np.sin(theta)
        width = np.sqrt(2.0) * self._m * np.cos(half)
        return np.arcsin(np.clip(mirrored, -1.0, 1.0)), np.maximum(width, MIN_BETA)


REFERENCE = Reference(lambda fibre, residual, profiles: _DEon(fibre, residual))
evaluate = REFERENCE.evaluate
direction_pdf = REFERENCE.direction_pdf
pdf = REFERENCE.pdf
sample = REFERENCE.sample
attenuation = REFERENCE.attenuation
albedo = REFERENCE.albedo
lobe_shares = REFERENCE.lobe_shares
