"""Float64 reference of the fibre of Marschner et al. 2003.

The lobe around the fibre is that of furcl.fibre.marschner.azimuth, theta_h and theta_d are half the
sum and the difference of the inclinations:

    f = k sum over p of g(theta_h - alpha_p; beta_p) N_p(phi, theta_d) cos(theta_o) / cos^2(theta_d)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.fibre.closed.reference import LEAST_COS, Closed, ClosedReference
from furcl.fibre.double_cylinder.reference.pairs import angles, unit_vectors
from furcl.fibre.marschner import azimuth
from furcl.fibre.marschner.parameters import MarschnerFibre

Array = NDArray[np.float64]

REACH = 1.5


def _half_difference(theta: Array, theta_o: Array) -> Array:
    """|theta_d|, no nearer to the axis than LEAST_COS."""
    return np.minimum(np.abs(theta_o - theta) / 2.0, np.arccos(LEAST_COS))


class _Marschner(Closed):
    names = azimuth.LOBES

    def __init__(self, fibre: MarschnerFibre) -> None:
        self._fibre = fibre
        a, b = np.deg2rad(-abs(fibre.alpha_deg)), np.deg2rad(fibre.beta_deg)
        self._along = {"R": (a, b), "TT": (-a / 2.0, b / 2.0), "TRT": (-3.0 * a / 2.0, 2.0 * b)}
        self._norm = {"unit": 0.5, "published": 1.0}[fibre.norm]

    def energy(self, name: str, theta: Array) -> Array:
        """The mean of A_p over the bins of h, and the glints', at |theta| no nearer to the axis
        than the lobe reaches."""
        limit = np.pi / 2 - min(REACH * self._along[name][1], np.pi / 2)
        inclination = np.minimum(np.abs(theta), limit)
        energy = azimuth.binned(self._fibre, name, inclination)[0]
        if name == "TRT":
            energy = energy + azimuth.caustic(self._fibre, inclination).energy
        return energy

    def _bell(self, name: str, theta: Array, theta_o: Array) -> Array:
        alpha, beta = self._along[name]
        x = ((theta_o + theta) / 2.0 - alpha) / beta
        return np.exp(-0.5 * x**2) / (np.sqrt(2.0 * np.pi) * beta)

    def value(
        self, name: str, theta: Array, theta_o: Array, phi: Array, eta: Array | None = None
    ) -> Array:
        half = _half_difference(theta, theta_o)
        n = azimuth.far_field(self._fibre, name, phi, half, eta)
        factor = self._bell(name, theta, theta_o) * np.cos(theta_o) / np.cos(half) ** 2
        return self._norm * factor[..., None] * n

    def density(
        self, name: str, theta: Array, theta_o: Array, phi: Array, by_attenuation: bool
    ) -> Array:
        half = _half_difference(theta, theta_o)
        along = self._bell(name, theta, theta_o) / (2.0 * np.maximum(np.cos(theta_o), LEAST_COS))
        return along * azimuth.density(self._fibre, name, phi, half, by_attenuation)

    def draw(
        self, name: str, theta: Array, rng: np.random.Generator, by_attenuation: bool
    ) -> tuple[Array, Array]:
        alpha, beta = self._along[name]
        theta_o = 2.0 * (alpha + beta * rng.standard_normal(len(theta))) - theta
        half = _half_difference(theta, theta_o)
        return theta_o, azimuth.draw(self._fibre, name, half, rng, by_attenuation)

    def albedo(self, name: str, theta: Array) -> Array:
        """Gauss-Legendre over theta_o; around the fibre an exact integral over h, but for the
        factors that take out the caustics."""
        alpha, beta = self._along[name]
        x, w = np.polynomial.legendre.leggauss(48)
        low = np.maximum(-np.pi / 2, 2.0 * (alpha - 7.0 * beta) - theta)[..., None]
        high = np.minimum(np.pi / 2, 2.0 * (alpha + 7.0 * beta) - theta)[..., None]
        width = np.maximum(high - low, 0.0) / 2.0
        theta_o = (low + high) / 2.0 + width * x
        half = (theta_o - theta[..., None]) / 2.0
        around = azimuth.integral(self._fibre, name, np.abs(half))
        factor = self._bell(name, theta[..., None], theta_o) * (np.cos(theta_o) / np.cos(half)) ** 2
        return self._norm * np.einsum("...n,...nc->...c", width * w * factor, around)


REFERENCE = ClosedReference(_Marschner)


def elliptical(fibre: MarschnerFibre, wo: ArrayLike, wi: ArrayLike) -> Any:
    """Value (..., 3) [1/sr] of TRT of an elliptical fibre, whose minor axis is y.

    Parameters
    ----------
    wo, wi : (..., 3)   unit vectors in the fibre's frame

    The index of refraction in TRT is taken for the one of eta_1 and eta_2 that the azimuth half-way
    says (Marschner et al. 2003); axis_ratio 1 gives the circle.
    """
    theta, phi_in = angles(unit_vectors("wo", wo))
    theta_o, phi_out = angles(unit_vectors("wi", wi))
    phi = phi_out - phi_in
    phi = phi - 2.0 * np.pi * np.rint(phi / (2.0 * np.pi))
    a_sq, eta = fibre.axis_ratio**2, fibre.eta
    low, high = (2.0 * (eta - 1.0) * s - eta + 2.0 for s in (a_sq, 1.0 / a_sq))
    of_azimuth = (low + high + np.cos(2.0 * (phi_in + phi / 2.0)) * (low - high)) / 2.0
    return _Marschner(fibre).value("TRT", theta, theta_o, phi, of_azimuth)


evaluate = REFERENCE.evaluate
direction_pdf = REFERENCE.direction_pdf
pdf = REFERENCE.pdf
sample = REFERENCE.sample
attenuation = REFERENCE.attenuation
albedo = REFERENCE.albedo
lobe_shares = REFERENCE.lobe_shares
