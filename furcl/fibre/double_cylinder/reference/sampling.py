"""Draws of lobe, offset and direction together, and their density.

Written from the model and the paper alone; the kernels' samplers approximate these by tables.
"""

import reprlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference import scattered, whole_fibre
from furcl.fibre.double_cylinder.reference.angles import centre_and_width
from furcl.fibre.double_cylinder.reference.model import density, unscattered_share, value
from furcl.fibre.double_cylinder.reference.offsets import choice_of, lobe_names
from furcl.fibre.double_cylinder.reference.optics import (
    LOBES,
    RESIDUAL,
    SCATTERED,
    attenuation,
    geometry,
)
from furcl.fibre.double_cylinder.reference.pairs import (
    Pair,
    angles,
    lobe_name,
    pair_of,
    sampling_name,
    unit_vectors,
)
from furcl.fibre.double_cylinder.reference.profiles import MedullaData, profiles_in_use

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """n draws of one call of `sample`."""

    wi: Array
    """(n, 3) unit vectors in the fibre's frame; zero where no lobe carries light"""
    h: Array
    """(n,) offsets, [-1, 1]"""
    lobe: NDArray[np.intp]
    """(n,) indices into LOBES, 5 the residual; the number of lobes where none carries light"""
    weight: Array
    """(n, 3) what radiance from wi is multiplied with; its mean is the albedo"""
    pdf: Array
    """(n,) density of (lobe, h, wi) [1/sr per unit of h]"""


def pdf(
    fibre: Fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    h: ArrayLike,
    profiles: MedullaData,
    /,
    *,
    sampling: str,
    lobe: str | int | None = None,
    residual: bool = False,
) -> Array:
    """Density with which `sample` returns (lobe, h, wi), or (h, wi) for lobe = None.

    Parameters
    ----------
    wo, wi : (..., 3)   unit vectors in the fibre's frame
    h : (...)           offset, [-1, 1]
    profiles            as for `attenuation`; by position only, so that a call that is meant for
                        `direction_pdf` fails
    sampling : str      as for `sample`
    lobe                name or index; None adds all up
    residual : bool     whether the lobe "residual" is among those drawn

    Returns
    -------
    (...) float64       [1/sr per unit of h]: the integral over wi and h in [-1, 1] of the sum over
                        lobes is 1. `0.5 * evaluate(..., lobe) / pdf(..., lobe)` is the weight of a
                        sample, 0.5 being the density of h over the width of the fibre

    Raises
    ------
    FibreError          as `evaluate`; unknown sampling; the residual lobe without residual = True
    """
    pair = pair_of(fibre, wo, wi, h)
    names = lobe_names(fibre, residual)
    asked = names if lobe is None else [lobe_name(lobe)]
    if asked[0] not in names:
        raise FibreError(
            f"bcsdf: lobe {lobe!r} is not drawn without residual=True - allowed are "
            f"{', '.join(names)} - pass residual=True, which changes the densities of all lobes"
        )
    uniform_angles = sampling_name(sampling) != "full-cdf"
    used = profiles_in_use(fibre, profiles)
    choice = choice_of(sampling, fibre, pair.theta_i.ravel(), profiles, residual)
    q = choice.densities(pair.h.ravel())
    total = np.zeros(pair.h.shape)
    for name in asked:
        of_lobe = q[names.index(name)].reshape(pair.h.shape)
        total += of_lobe * density(fibre, pair, name, used, uniform_angles)
    return total


def sample(
    fibre: Fibre,
    wo: ArrayLike,
    n: int | None = None,
    profiles: MedullaData = None,
    *,
    sampling: str,
    rng: np.random.Generator | int,
    residual: bool = False,
) -> Samples:
    """Draw lobes, offsets and directions.

    Parameters
    ----------
    wo : (3,) or (n, 3)     unit vectors in the fibre's frame
    n : int                 number of draws, for one wo
    profiles                as for `attenuation`
    sampling : str          "uniform-h": h uniform, then the lobe by A_p(h), mean of the channels;
                            TTs and TRTs uniform on the sphere (d'Eon et al. 2013, Yan et al. 2017).
                            "attenuation-cdf": the lobe by the integral of A_p over h, then h from
                            the lobe's 200 bins; directions as before (Shibaike and Iwasaki).
                            "full-cdf": the same, but TTs and TRTs from their profiles
    rng : Generator or int  source of random numbers, or its seed
    residual : bool         with the lobe "residual"

    Returns
    -------
    Samples                 wi, h, lobe, weight, pdf

    Raises
    ------
    FibreError              vectors that are not of unit length or not n; unknown sampling; no
                            profiles of a medulla that scatters

    These are the samplers in their exact form. The bins are those of the inclination of wo itself;
    the device has 32 rows over |theta|, even in sqrt(cos(theta)), of which it takes one of the two
    around theta at random, and its densities are that mixture. Here a bin has the mean of A_p; on
    the device one with a narrow peak is lifted, as are bins that are almost empty
    (docs/model.md, "Peaks"). So densities and lobe counts differ a little, integrals do not.

    One table is made for each distinct |theta|: many different wo take long.
    """
    wo = unit_vectors("wo", wo)
    one = wo.ndim == 1 and isinstance(n, int | np.integer) and n >= 0
    if not one and not (wo.ndim == 2 and n is None):
        raise FibreError(
            f"bcsdf: wo has shape {wo.shape} and n = {reprlib.repr(n)} - allowed are one vector "
            "(3,) and a number n of draws, or vectors (n, 3) without n - profiles come after n"
        )
    rng = np.random.default_rng(rng)
    wo = np.broadcast_to(wo, (n, 3)) if n is not None else wo
    used = profiles_in_use(fibre, profiles)
    uniform_angles = sampling_name(sampling) != "full-cdf"
    theta, azimuth = angles(wo)
    choice = choice_of(sampling, fibre, theta, profiles, residual)
    lobe, h = choice.draw(rng)
    q = choice.densities(h)
    wi, weight, density_of = np.zeros(wo.shape), np.zeros(wo.shape), np.zeros(len(wo))
    for index, name in enumerate(lobe_names(fibre, residual)):
        mine = np.flatnonzero(lobe == index)
        if not len(mine):
            continue
        pair = _draw_direction(fibre, name, theta[mine], h[mine], used, uniform_angles, rng)
        cos, phi = np.cos(pair.theta_o), azimuth[mine] + pair.phi
        wi[mine] = np.stack([pair.s_o, cos * np.cos(phi), cos * np.sin(phi)], 1)
        of_lobe = density(fibre, pair, name, used, uniform_angles)
        a = attenuation(fibre, pair.h, pair.theta_i, profiles, name == RESIDUAL)[name]
        if name in SCATTERED or (name == RESIDUAL and fibre.is_simulated):
            a = value(fibre, pair, name, used, a) / of_lobe[:, None]
        weight[mine] = 0.5 * a / q[index, mine, None]
        density_of[mine] = q[index, mine] * of_lobe
    return Samples(wi, h, lobe, weight, density_of)


def _draw_direction(
    fibre: Fibre,
    name: str,
    theta: Array,
    h: Array,
    used: Any,
    uniform_angles: bool,
    rng: np.random.Generator,
) -> Pair:
    """Directions of one lobe for each of theta, h (n,), in the model's angles; those of TTs and
    TRTs from the profiles in use, or uniform on the sphere."""
    geo, n = geometry(fibre, h, theta), len(h)
    if name == RESIDUAL and fibre.is_simulated:
        return _draw_later(fibre, theta, h, used, uniform_angles, rng)
    if name in SCATTERED and uniform_angles:
        phi, s = rng.uniform(-np.pi, np.pi, n), rng.uniform(-1.0, 1.0, n)
        return Pair(theta, np.arcsin(s), s, phi, h, geo)
    if name in SCATTERED and fibre.is_simulated:
        return _draw_simulated(fibre, name, theta, h, used, rng)
    if name in SCATTERED:
        start = Pair(theta, theta, theta, np.zeros(n), h, geo).phi_q(name)
        phi = scattered.draw_azimuth(fibre, used, geo.cos_theta_t, geo.h_t, rng) - start
        s = scattered.draw_sine(fibre, used, theta, phi, rng)
        return Pair(theta, np.arcsin(s), s, phi, h, geo)
    p = 2 if name == RESIDUAL else LOBES.index(name)
    phi = geo.Phi(p) + fibre.beta_n * np.sqrt(p + 1.0) * rng.standard_normal(n)
    if name == RESIDUAL:
        phi = rng.uniform(-np.pi, np.pi, n)
    # R depends on phi, which therefore comes first.
    theta_o = draw_inclination(*centre_and_width(fibre, p, theta, phi), rng)
    return Pair(theta, theta_o, np.sin(theta_o), phi, h, geo)


def _draw_simulated(
    fibre: Fibre, name: str, theta: Array, h: Array, used: Any, rng: np.random.Generator
) -> Pair:
    geo = geometry(fibre, h, theta)
    start = Pair(theta, theta, theta, np.zeros(len(h)), h, geo).phi_q(name)
    phi, s = whole_fibre.draw(fibre, used, theta, geo.h_t, rng)
    return Pair(theta, np.arcsin(s), s, phi - start, h, geo)


def _draw_later(
    fibre: Fibre, theta: Array, h: Array, used: Any, uniform_angles: bool, rng: np.random.Generator
) -> Pair:
    """Of the residual lobe, all orders that have none: light that was never scattered, or other."""
    geo, n = geometry(fibre, h, theta), len(h)
    phi = geo.Phi(3) + 2.0 * fibre.beta_n * rng.standard_normal(n)
    theta_o = draw_inclination(*centre_and_width(fibre, 2, theta, phi), rng)
    other = rng.random(n) >= unscattered_share(fibre, theta, h, used)
    if used is not None and other.any():
        if uniform_angles:
            phi[other] = rng.uniform(-np.pi, np.pi, other.sum())
            theta_o[other] = np.arcsin(rng.uniform(-1.0, 1.0, other.sum()))
        else:
            drawn = _draw_simulated(fibre, RESIDUAL, theta[other], h[other], used, rng)
            phi[other], theta_o[other] = drawn.phi, drawn.theta_o
    return Pair(theta, theta_o, np.sin(theta_o), phi, h, geo)


def draw_inclination(mu: Array, beta: Array, rng: np.random.Generator) -> Array:
    """theta_o [rad] with the longitudinal density of centre mu and width beta.

    m_p is the density of the sine of directions that are distributed as exp(cos(angle) / v) around
    one of inclination mu (d'Eon et al. 2013): the cosine is drawn from its own distribution, the
    turn about the centre uniformly.
    """
    v = beta * beta
    below_one = -v * np.log1p(rng.random(mu.shape) * np.expm1(-2.0 / v))
    across = np.sqrt(np.maximum(below_one * (2.0 - below_one), 0.0))
    turn = rng.uniform(-np.pi, np.pi, mu.shape)
    towards = (1.0 - below_one) * np.cos(mu) - across * np.cos(turn) * np.sin(mu)
    along = (1.0 - below_one) * np.sin(mu) + across * np.cos(turn) * np.cos(mu)
    return np.arctan2(along, np.hypot(towards, across * np.sin(turn)))
