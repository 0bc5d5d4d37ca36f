"""The scattering function, and the density of each lobe's directions, at a given offset h."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference import scattered
from furcl.fibre.double_cylinder.reference.angles import D_p, centre_and_width, longitudinal
from furcl.fibre.double_cylinder.reference.optics import LOBES, RESIDUAL, SCATTERED, attenuation
from furcl.fibre.double_cylinder.reference.pairs import (
    Pair,
    lobe_name,
    pair_of,
    sampling_name,
)
from furcl.fibre.double_cylinder.reference.profiles import (
    UNSCATTERED,
    MedullaData,
    Profiles,
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
    names = [*LOBES, *([RESIDUAL] if residual else [])] if lobe is None else [lobe_name(lobe)]
    used = profiles_in_use(fibre, profiles) if {*SCATTERED, RESIDUAL} & set(names) else None
    a = attenuation(
        fibre, pair.h, pair.theta_i, UNSCATTERED if used is None else used, RESIDUAL in names
    )
    total = np.zeros((*pair.phi.shape, 3))
    for name in names:
        total += value(fibre, pair, name, used, a[name])
    return total


def value(fibre: Fibre, pair: Pair, name: str, used: Profiles | None, a: Array) -> Array:
    """Value (..., 3) of one lobe whose attenuation is a (..., 3)."""
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


def density(
    fibre: Fibre, pair: Pair, name: str, used: Profiles | None, uniform_angles: bool
) -> Array:
    """Density (...) of one lobe's directions per solid angle; of TTs and TRTs over the whole
    sphere, or from the profiles."""
    if name in SCATTERED:
        if uniform_angles:
            return np.full(pair.phi.shape, 1.0 / (4.0 * np.pi))
        if used is None:
            return np.zeros(pair.phi.shape)
        geo = pair.geo
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
    if name not in SCATTERED or not fibre.has_medulla:
        return density(fibre, pair, name, None, False)
    used = None if uniform else profiles_in_use(fibre, profiles)
    return density(fibre, pair, name, used, uniform)
