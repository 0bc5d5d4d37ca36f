"""Angular densities of the unscattered lobes: longitudinal m_p over sin(theta), azimuthal D_p over
phi."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import i0e

from furcl.fibre.double_cylinder.parameters import Fibre

Array = NDArray[np.float64]

MIN_BETA = 1e-3
"""Smallest longitudinal width in use [rad]; narrower lobes (TT of a smooth fibre, R near phi = pi)
are widened to it."""


def wrap(angle: ArrayLike) -> Array:
    """The angle in [-pi, pi] that is equal modulo 2 pi."""
    x = np.asarray(angle, np.float64)
    return x - 2.0 * np.pi * np.rint(x / (2.0 * np.pi))


def m_p(s_o: ArrayLike, mu: ArrayLike, v: ArrayLike) -> Array:
    """Longitudinal density in s = sin(theta) around inclination mu.

    Parameters
    ----------
    s_o : (...)   sine of the outgoing inclination, [-1, 1]
    mu : (...)    centre [rad], any; beyond the pole it continues on the other side
    v : (...)     variance [rad^2], > 0

    Returns
    -------
    (...) float64   density per unit of s, >= 0, with integral 1 over [-1, 1] for every mu and v
                    (tests/test_bcsdf_angles.py::test_longitudinal_integral, v 1e-6..6)

    Source: d'Eon et al. 2011, the spherical Gaussian averaged over azimuth, in the half-angle form
    with the scaled Bessel function, which neither overflows nor cancels.
    """
    s = np.asarray(s_o, np.float64)
    return longitudinal(np.arctan2(s, np.sqrt((1.0 - s) * (1.0 + s))), mu, v)


def longitudinal(theta_o: ArrayLike, mu: ArrayLike, v: ArrayLike) -> Array:
    """`m_p` at the inclination theta_o [rad] itself, exact near the poles too."""
    theta_o, mu, v = (np.asarray(x, np.float64) for x in (theta_o, mu, v))
    mu = wrap(mu)
    mu = np.where(np.abs(mu) > np.pi / 2, np.copysign(np.pi, mu) - mu, mu)
    peak = np.exp(-2.0 * np.sin(0.5 * (mu - theta_o)) ** 2 / v)
    return peak * i0e(np.cos(mu) * np.cos(theta_o) / v) / (-v * np.expm1(-2.0 / v))


def cone(fibre: Fibre, theta_i: ArrayLike, phi: ArrayLike) -> tuple[Array, Array]:
    """Centre mu_R and width beta_R of the reflection lobe, which depend on the azimuth phi.

    Parameters
    ----------
    theta_i : (...)   inclination of the known direction [rad]
    phi : (...)       azimuth difference [rad], any

    Returns
    -------
    mu_R, beta_R : (...) [rad]

    Source: d'Eon, Marschner and Hanika 2014. phi = 0 gives -theta_i + 2a exactly.
    """
    theta_i, phi = np.asarray(theta_i, np.float64), wrap(phi)
    a = fibre.tilt
    u = np.cos(0.5 * phi) * np.cos(a) * np.cos(theta_i) + np.sin(a) * np.sin(theta_i)
    mu = -np.arcsin(np.clip(np.sin(theta_i) - 2.0 * np.sin(a) * u, -1.0, 1.0))
    width = fibre.beta_m * np.sqrt(2.0) * np.abs(np.cos(0.5 * phi))
    return mu, np.maximum(width, MIN_BETA)


def centre_and_width(
    fibre: Fibre, p: int, theta_i: ArrayLike, phi: ArrayLike
) -> tuple[Array, Array]:
    """mu_p and beta_p [rad] of R, TT and TRT (p = 0, 1, 2).

    Shifts 2a, -a and -3a (a scale tilted by a turns a reflection by 2a); widths beta_m, beta_m/2
    and 3 beta_m/2.
    """
    if p == 0:
        return cone(fibre, theta_i, phi)
    shift, factor = ((-1.0, 0.5), (-3.0, 1.5))[p - 1]
    mu = -np.asarray(theta_i, np.float64) + shift * fibre.tilt
    return mu, np.full_like(mu, max(factor * fibre.beta_m, MIN_BETA))


def wrapped_gaussian(delta: ArrayLike, beta: float) -> Array:
    """Normal density of width beta [rad] on the circle; as many images as float64 can see."""
    d = wrap(delta)[..., None]
    images = 1 + int(np.ceil(9.0 * beta / (2.0 * np.pi)))
    turns = 2.0 * np.pi * np.arange(-images, images + 1)
    return np.exp(-0.5 * ((d + turns) / beta) ** 2).sum(-1) / (np.sqrt(2.0 * np.pi) * beta)


def D_p(fibre: Fibre, p: int, delta: ArrayLike) -> Array:
    """Azimuthal density of R, TT and TRT (p = 0, 1, 2) at delta = phi - Phi_p(h) [rad], any.

    A wrapped Gaussian of width beta_n sqrt(p + 1); integral 1 over a turn
    (test_bcsdf_angles.py::test_azimuthal_integral).
    """
    return wrapped_gaussian(delta, fibre.beta_n * np.sqrt(p + 1.0))
