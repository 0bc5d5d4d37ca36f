"""The scattering function, and the density of each lobe's directions, at a given offset h."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference import scattered, whole_fibre
from furcl.fibre.double_cylinder.reference.angles import D_p, centre_and_width, longitudinal
from furcl.fibre.double_cylinder.reference.offsets import lobe_names
from furcl.fibre.double_cylinder.reference.optics import (
    LOBES,
    RESIDUAL,
    SCATTERED,
    attenuation,
)
from furcl.fibre.double_cylinder.reference.pairs import (
    Pair,
    lobe_name,
    pair_of,
    sampling_name,
)
from furcl.fibre.double_cylinder.reference.profiles import (
    UNSCATTERED,
    MedullaData,
    profiles_in_use,
)

Array = NDArray[np.float64]


def evaluate(
    fibre: Fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    h: ArrayLike,
    profiles: MedullaData = None,
    lobe: str | int | None = None,
    residual: bool = False,
) -> Array:
    """Value of the scattering function at a fixed offset: sum over lobes of A_p(h) D_p(phi | h)
    m_p(s).

    Parameters
    ----------
    wo, wi : (..., 3)   unit vectors in the fibre's frame: known direction, other direction
    h : (...)           offset of wo's ray, [-1, 1]
    profiles            as for `attenuation`; R, TT and TRT alone need none
    lobe                one lobe (name or index) instead of the sum
    residual : bool     adds the lobe "residual" to the sum

    Returns
    -------
    (..., 3) float64    [1/sr], the cosine included; its integral over wi is the sum of
                        `attenuation`

    Raises
    ------
    FibreError          vectors that are not of unit length, h outside its range, unknown lobe; a
                        medulla that scatters, but no profiles

    The far field is the mean of this over h in [-1, 1].
    """
    pair = pair_of(fibre, wo, wi, h)
    names = lobe_names(fibre, residual) if lobe is None else [lobe_name(lobe)]
    used = profiles_in_use(fibre, profiles) if {*SCATTERED, RESIDUAL} & set(names) else None
    a = attenuation(
        fibre, pair.h, pair.theta_i, UNSCATTERED if used is None else used, RESIDUAL in names
    )
    total = np.zeros((*pair.phi.shape, 3))
    for name in names:
        total += value(fibre, pair, name, used, a[name])
    return total


def value(fibre: Fibre, pair: Pair, name: str, used: Any, a: Array) -> Array:
    """Value (..., 3) of one lobe whose attenuation is a (..., 3)."""
    if name == RESIDUAL and fibre.is_simulated:
        never = attenuation(fibre, pair.h, pair.theta_i, UNSCATTERED)[RESIDUAL]
        return never * _never_scattered(fibre, pair)[..., None] + _simulated_value(
            fibre, pair, name, used, a - never
        )
    if name in SCATTERED and fibre.is_simulated:
        return _simulated_value(fibre, pair, name, used, a)
    if name not in SCATTERED:
        return a * density(fibre, pair, name, used, False)[..., None]
    if used is None:
        return np.zeros_like(a)
    # As its density, with the absorption of the paths that leave at this azimuth.
    geo = pair.geo
    whole = scattered.escape(fibre, used, geo.cos_theta_t, geo.h_t)
    _, part = scattered.azimuthal(fibre, used, geo.cos_theta_t, geo.h_t, pair.phi_q(name))
    along = scattered.longitudinal(fibre, used, pair.theta_i, pair.s_o, pair.phi)
    entering = np.divide(a, whole, out=np.zeros_like(a), where=whole > 0.0)
    return entering * part * along[..., None]


def _simulated_value(fibre: Fibre, pair: Pair, name: str, used: Any, a: Array) -> Array:
    """Value (..., 3) of light that the medulla has scattered, of attenuation a."""
    if used is None:
        return np.zeros_like(a)
    h_t = pair.geo.h_t
    whole = whole_fibre.escape(fibre, used, pair.theta_i, h_t)
    _, part = whole_fibre.leaving(fibre, used, pair.theta_i, h_t, pair.phi_q(name), pair.s_o)
    return np.divide(a, whole, out=np.zeros_like(a), where=whole > 0.0) * part


def _never_scattered(fibre: Fibre, pair: Pair) -> Array:
    """Density (...) of the light of the residual that was never scattered, where scattering is
    simulated: about the azimuth of TRRT, with the inclination of TRT."""
    mu, beta = centre_and_width(fibre, 2, pair.theta_i, pair.phi)
    along = longitudinal(pair.theta_o, mu, beta * beta)
    return along * D_p(fibre, 3, pair.phi - pair.geo.Phi(3))


def unscattered_share(fibre: Fibre, theta_i: Array, h: Array, used: Any) -> Array:
    """Share (...) of light that was never scattered in the residual, mean of the channels: that of
    TT over TT and TTs, whose energies each have (F T)^2 / (1 - F T) of it, which may be too small a
    number; over the largest (F T)^2."""
    lobes = attenuation(fibre, h, theta_i, used or UNSCATTERED, True)
    never, other = lobes["TT"], lobes["TTs"] if used is not None else np.zeros_like(lobes["TT"])
    largest = never.max(-1, keepdims=True)
    passed = np.divide(never, largest, out=np.ones_like(never), where=largest > 0.0)
    one_way = np.square(1.0 - lobes["R"])
    crossing = np.divide(never, one_way, out=np.zeros_like(never), where=one_way > 0.0)
    weight = passed * passed / (1.0 - lobes["R"] * crossing)
    kept = (weight * never).mean(-1)
    whole = kept + (weight * other).mean(-1)
    return np.divide(kept, whole, out=np.ones_like(kept), where=whole > 0.0)


def density(fibre: Fibre, pair: Pair, name: str, used: Any, uniform_angles: bool) -> Array:
    """Density (...) of one lobe's directions per solid angle; of TTs and TRTs over the whole
    sphere, or from the profiles."""
    if name == RESIDUAL and fibre.is_simulated:
        share = unscattered_share(fibre, pair.theta_i, pair.h, used)
        other = density(fibre, pair, "TTs", used, True) if uniform_angles else np.zeros(share.shape)
        if used is not None and not uniform_angles:
            other, _ = whole_fibre.leaving(
                fibre, used, pair.theta_i, pair.geo.h_t, pair.phi_q(name), pair.s_o
            )
        return share * _never_scattered(fibre, pair) + (1.0 - share) * other
    if name in SCATTERED:
        if uniform_angles:
            return np.full(pair.phi.shape, 1.0 / (4.0 * np.pi))
        if used is None:
            return np.zeros(pair.phi.shape)
        geo = pair.geo
        if fibre.is_simulated:
            return whole_fibre.leaving(
                fibre, used, pair.theta_i, geo.h_t, pair.phi_q(name), pair.s_o
            )[0]
        azimuth, _ = scattered.azimuthal(fibre, used, geo.cos_theta_t, geo.h_t, pair.phi_q(name))
        return azimuth * scattered.longitudinal(fibre, used, pair.theta_i, pair.s_o, pair.phi)
    p = 2 if name == RESIDUAL else LOBES.index(name)
    mu, beta = centre_and_width(fibre, p, pair.theta_i, pair.phi)
    along = longitudinal(pair.theta_o, mu, beta * beta)
    if name == RESIDUAL:
        return along / (2.0 * np.pi)
    return along * D_p(fibre, p, pair.phi - pair.geo.Phi(p))


def direction_pdf(
    fibre: Fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    h: ArrayLike,
    profiles: MedullaData = None,
    *,
    lobe: str | int,
    sampling: str,
) -> Array:
    """Density with which a lobe that was chosen at offset h sends light to wi.

    Parameters
    ----------
    wo, wi : (..., 3)   unit vectors in the fibre's frame
    h : (...)           offset, [-1, 1]
    profiles            as for `attenuation`; needed by TTs and TRTs in "full-cdf"
    lobe                name or index
    sampling : str      "full-cdf": TTs and TRTs from their profiles; "attenuation-cdf",
                        "uniform-h": uniform on the sphere

    Returns
    -------
    (...) float64       [1/sr], integral 1 over the sphere; 0 for TTs and TRTs where nothing
                        scatters

    Raises
    ------
    FibreError          as `evaluate`, and for an unknown sampling
    """
    pair, name = pair_of(fibre, wo, wi, h), lobe_name(lobe)
    uniform = sampling_name(sampling) != "full-cdf"
    if name == RESIDUAL and fibre.is_simulated:
        return density(fibre, pair, name, profiles_in_use(fibre, profiles), uniform)
    if name not in SCATTERED or not fibre.has_medulla:
        return density(fibre, pair, name, None, False)
    used = None if uniform else profiles_in_use(fibre, profiles)
    return density(fibre, pair, name, used, uniform)
