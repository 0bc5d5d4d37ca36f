"""Cuticle reflectance, path geometry and attenuation of the lobes at one offset h."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.profiles import MedullaData, profiles_in_use
from furcl.fibre.double_cylinder.reference.scattered import escape
from furcl.fibre.double_cylinder.reference.whole_fibre import escape as escape_of_fibre

LOBES = ("R", "TT", "TRT", "TTs", "TRTs")
"""The five lobes in the order used everywhere; an s marks light scattered in the medulla."""

SCATTERED = ("TTs", "TRTs")
"""Those of them that need the medulla's profiles."""

RESIDUAL = "residual"
"""The optional sixth lobe: all that leaves after two or more internal reflections, TRRT and later
orders, whether the medulla scattered it or not."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Geometry:
    """The refracted ray at offset h, projected along the fibre; lengths in radii."""

    cos_theta_i: Array
    cos_theta_t: Array
    gamma_i: Array
    gamma_t: Array
    h_t: Array
    """sin(gamma_t), the offset inside, signed."""
    cortex: Array
    """s_c: one of the two stretches of cortex of a crossing."""
    medulla: Array
    """s_m: half the chord in the medulla; 0 where the ray misses it."""

    def Phi(self, p: int) -> Array:
        """Azimuth change of the path with p internal stretches."""
        return 2.0 * p * self.gamma_t - 2.0 * self.gamma_i + p * np.pi


def checked(h: ArrayLike, theta: ArrayLike) -> tuple[Array, Array]:
    """h and theta of one shape in float64; FibreError if one is outside its range."""
    h, theta = np.broadcast_arrays(np.asarray(h, np.float64), np.asarray(theta, np.float64))
    if not np.all(np.abs(h) <= 1.0):
        raise FibreError(
            "bcsdf: h has values outside [-1, 1] - give the hit offset over the radius"
        )
    if not np.all(np.abs(theta) <= np.pi / 2):
        raise FibreError(
            "bcsdf: theta has values outside [-pi/2, pi/2] - give the inclination in radians"
        )
    return h, theta


def cuticle(fibre: Fibre, h: ArrayLike, theta: ArrayLike) -> tuple[Array, Array]:
    """Reflectance F of the cuticle and its complement 1 - F.

    Parameters
    ----------
    h : (...)       offset, [-1, 1]
    theta : (...)   inclination of the known direction [rad], [-pi/2, pi/2]

    Returns
    -------
    F, 1 - F : (...) float64   each formed without cancellation

    Exact three-dimensional Fresnel reflectances f of the interface; per polarisation a scale is a
    slab, 2f/(1+f), `layers` of them reflect 2lf/(1 + (2l-1)f) (Stokes); then the mean of both
    polarisations.
    """
    h, theta = checked(h, theta)
    cos = np.cos(theta) * np.sqrt((1.0 - h) * (1.0 + h))
    e = (fibre.eta - 1.0) * (fibre.eta + 1.0)
    eta2 = fibre.eta * fibre.eta
    n = np.sqrt(e + cos * cos)
    f_s = (e / (cos + n) ** 2) ** 2
    t_s = 4.0 * cos * n / (cos + n) ** 2
    f_p = (e * ((eta2 + 1.0) * cos * cos - 1.0) / (eta2 * cos + n) ** 2) ** 2
    t_p = 4.0 * eta2 * cos * n / (eta2 * cos + n) ** 2
    if fibre.layers == 0.0:
        return np.zeros_like(cos), np.ones_like(cos)
    r_s, r_p = 2.0 * fibre.layers * f_s, 2.0 * fibre.layers * f_p
    reflected = 0.5 * (r_s / (t_s + r_s) + r_p / (t_p + r_p))
    passed = 0.5 * (t_s / (t_s + r_s) + t_p / (t_p + r_p))
    return reflected, passed


def geometry(fibre: Fibre, h: ArrayLike, theta: ArrayLike) -> Geometry:
    """Angles and path lengths of the refracted ray; finite everywhere, grazing incidence included.

    Parameters
    ----------
    h : (...)       offset, [-1, 1]
    theta : (...)   inclination of the known direction [rad], [-pi/2, pi/2]
    """
    h, theta = checked(h, theta)
    cos_i = np.cos(theta)
    n_t = np.sqrt((fibre.eta - 1.0) * (fibre.eta + 1.0) + cos_i * cos_i)
    h_t = h * cos_i / n_t
    cos_gamma_t = np.sqrt((1.0 - h_t) * (1.0 + h_t))
    kappa, size = fibre.kappa, np.abs(h_t)
    medulla = np.sqrt(np.maximum(0.0, (kappa - size) * (kappa + size)))
    cortex = np.where(
        size < kappa, (1.0 - kappa) * (1.0 + kappa) / (cos_gamma_t + medulla), cos_gamma_t
    )
    return Geometry(
        cos_theta_i=cos_i,
        cos_theta_t=n_t / fibre.eta,
        gamma_i=np.arcsin(h),
        gamma_t=np.arcsin(h_t),
        h_t=h_t,
        cortex=cortex,
        medulla=medulla,
    )


def attenuation(
    fibre: Fibre,
    h: ArrayLike,
    theta_in: ArrayLike,
    profiles: MedullaData = None,
    residual: bool = False,
) -> dict[str, Array]:
    """Fraction A_p(h) of the light at offset h that leaves in each lobe, over all directions.

    Parameters
    ----------
    h : (...)           offset, [-1, 1]
    theta_in : (...)    inclination of the known direction [rad], [-pi/2, pi/2]
    profiles            scattering profiles of the medulla, UNSCATTERED to leave out what it
                        scatters, or None if it scatters nothing
    residual : bool     adds the lobe "residual": TRRT and all later orders; it is always there
                        where scattering is simulated

    Returns
    -------
    {"R", "TT", "TRT", "TTs", "TRTs"} -> (..., 3) float64, in [0, 1]

    Raises
    ------
    FibreError          h or theta_in outside its range; no profiles of a medulla that scatters

    R = F, TT = (1-F)^2 T, TRT = (1-F)^2 F T^2 with T the unscattered transmittance of one crossing;
    the scattered lobes are E_p q times the fraction that escapes absorption in the medulla. All
    that is scattered leaves the fibre: its exit through the cuticle is not attenuated, only the
    radial stretch of cortex is. Where scattering is simulated that fraction is the one of its
    tables, and there is no such stretch.

    With all profiles and no absorption R + ... + TRTs = 1 - (1-F) F^2 T^2; the residual lobe is
    exactly the rest, [(1-F)^2 F^2 T^3 + (1-F) F^2 T^2 E q esc] / (1 - F T), E being the cortex on
    the way to and from the scattering.
    """
    used = profiles_in_use(fibre, profiles)
    geo = geometry(fibre, h, theta_in)
    f, passed = (x[..., None] for x in cuticle(fibre, h, theta_in))
    inv_cos = (1.0 / geo.cos_theta_t)[..., None]
    s_c, s_m = geo.cortex[..., None], geo.medulla[..., None]
    ca = np.asarray(fibre.sigma_ca) * inv_cos
    ma = np.asarray(fibre.sigma_ma) * inv_cos
    ms = fibre.sigma_ms * inv_cos

    log_t = -2.0 * s_c * ca - 2.0 * s_m * (ma + ms)
    t = np.exp(log_t)
    t2 = np.exp(2.0 * log_t)
    scattered = np.zeros_like(log_t)
    if used is not None:
        q = -np.expm1(-2.0 * s_m * ms)
        if fibre.is_simulated:
            theta = np.broadcast_to(theta_in, geo.h_t.shape)
            scattered = np.exp(-s_c * ca) * q * escape_of_fibre(fibre, used, theta, geo.h_t)
        else:
            entry_and_exit = np.exp(-(s_c + (1.0 - fibre.kappa)) * ca)
            scattered = entry_and_exit * q * escape(fibre, used, geo.cos_theta_t, geo.h_t)
    result = {
        "R": f * np.ones(3),
        "TT": passed**2 * t,
        "TRT": passed**2 * f * t2,
        "TTs": passed * scattered,
        "TRTs": passed * f * t * scattered,
    }
    if residual or fibre.is_simulated:
        end = passed * t + scattered
        # 1 - F T with F -> 1 and T = 1: passed is exact, expm1 keeps the rest.
        rest = passed - f * np.expm1(log_t)
        part = np.where(rest > 0.0, passed / np.where(rest > 0.0, rest, 1.0), 0.0)
        result[RESIDUAL] = part * f**2 * t2 * end
    return result
