"""The scattering function and the densities of its lobes, at a given offset h."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference import scattered
from furcl.fibre.double_cylinder.reference.angles import D_p, centre_and_width, longitudinal
from furcl.fibre.double_cylinder.reference.optics import (
    LOBES,
    RESIDUAL,
    Geometry,
    attenuation,
    geometry,
)
from furcl.fibre.double_cylinder.reference.scattered import Profiles

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Pair:
    """A pair of directions at an offset, in the model's angles."""

    theta_i: Array
    theta_o: Array
    s_o: Array
    phi: Array
    h: Array
    geo: Geometry


def _pair(fibre: Fibre, wo: ArrayLike, wi: ArrayLike, h: ArrayLike) -> _Pair:
    known, other = _unit("wo", wo), _unit("wi", wi)
    theta_i, theta_o = (
        np.arctan2(w[..., 0], np.hypot(w[..., 1], w[..., 2])) for w in (known, other)
    )
    phi_i, phi_o = (np.arctan2(w[..., 2], w[..., 1]) for w in (known, other))
    theta_i, theta_o, s_o, phi, h = np.broadcast_arrays(
        theta_i, theta_o, other[..., 0], phi_o - phi_i, np.asarray(h, np.float64)
    )
    return _Pair(theta_i, theta_o, s_o, phi, h, geometry(fibre, h, theta_i))


def _unit(name: str, w: ArrayLike) -> Array:
    w = np.asarray(w, np.float64)
    if w.ndim == 0 or w.shape[-1] != 3 or not np.all(np.abs((w * w).sum(-1) - 1.0) <= 1e-3):
        raise FibreError(
            f"bcsdf: {name} has shape {w.shape} - allowed are unit vectors (..., 3) in the "
            "fibre's frame - normalise it; x is the tangent"
        )
    return w / np.sqrt((w * w).sum(-1, keepdims=True))


def _lobe_name(lobe: str | int) -> str:
    names = (*LOBES, RESIDUAL)
    if isinstance(lobe, str) and lobe in names:
        return lobe
    if not isinstance(lobe, str) and 0 <= lobe < len(names):
        return names[lobe]
    raise FibreError(
        f"bcsdf: lobe {lobe!r} is not known - allowed are {', '.join(names)} or 0 to 5"
    )


def _phi_q(pair: _Pair, p: int) -> Array:
    """Azimuth relative to the ray that enters the medulla after p - 1 internal reflections."""
    geo = pair.geo
    return pair.phi - (geo.gamma_t - geo.gamma_i) - (p - 1) * (np.pi + 2.0 * geo.gamma_t)


def _density(
    fibre: Fibre, pair: _Pair, name: str, profiles: Profiles | None, uniform_angles: bool
) -> Array:
    """Density of the lobe's directions per solid angle."""
    if name in ("TTs", "TRTs"):
        if uniform_angles:
            return np.full(pair.phi.shape, 1.0 / (4.0 * np.pi))
        if profiles is None:
            raise FibreError(
                f"bcsdf: the density of {name} needs the medulla's profiles - pass profiles="
            )
        if fibre.kappa == 0.0:
            return np.zeros(pair.phi.shape)
        phi_q = _phi_q(pair, 1 if name == "TTs" else 2)
        azimuth, _ = scattered.azimuthal(fibre, profiles, pair.geo.cos_theta_t, pair.geo.h_t, phi_q)
        return azimuth * scattered.longitudinal(fibre, profiles, pair.theta_i, pair.s_o, pair.phi)
    p = 2 if name == RESIDUAL else LOBES.index(name)
    mu, beta = centre_and_width(fibre, p, pair.theta_i, pair.phi)
    along = longitudinal(pair.theta_o, mu, beta * beta)
    if name == RESIDUAL:
        return along / (2.0 * np.pi)
    return along * D_p(fibre, p, pair.phi - pair.geo.Phi(p))


def evaluate(
    fibre: Fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    h: ArrayLike,
    profiles: Profiles | None = None,
    lobe: str | int | None = None,
    residual: bool = False,
) -> Array:
    """Value of the scattering function at a fixed offset: sum over lobes of A_p(h) D_p(phi | h)
    m_p(s).

    Parameters
    ----------
    wo, wi : (..., 3)   unit vectors in the fibre's frame: known direction, other direction
    h : (...)           offset of wo's ray, [-1, 1]
    profiles            scattering profiles of the medulla; without them TTs and TRTs are left out
    lobe                one lobe (name or index) instead of the sum
    residual : bool     adds the lobe "TRRT+" to the sum

    Returns
    -------
    (..., 3) float64    [1/sr], the cosine included; its integral over wi is the sum of
                        `attenuation`

    Raises
    ------
    FibreError          vectors that are not of unit length, h outside its range, unknown lobe

    The far field is the mean of this over h in [-1, 1].
    """
    pair = _pair(fibre, wo, wi, h)
    names = [*LOBES, *([RESIDUAL] if residual else [])] if lobe is None else [_lobe_name(lobe)]
    a = attenuation(fibre, pair.h, pair.theta_i, profiles, residual=RESIDUAL in names)
    total = np.zeros((*pair.phi.shape, 3))
    for name in names:
        if name not in ("TTs", "TRTs"):
            total += a[name] * _density(fibre, pair, name, profiles, False)[..., None]
        elif profiles is not None and fibre.has_medulla:
            total += _scattered_value(fibre, pair, name, profiles, a[name])
    return total


def _scattered_value(fibre: Fibre, pair: _Pair, name: str, profiles: Profiles, a: Array) -> Array:
    """A scattered lobe: as its density, with the absorption of the paths that leave at this
    azimuth."""
    geo = pair.geo
    phi_q = _phi_q(pair, 1 if name == "TTs" else 2)
    whole = scattered.escape(fibre, profiles, geo.cos_theta_t, geo.h_t)
    _, part = scattered.azimuthal(fibre, profiles, geo.cos_theta_t, geo.h_t, phi_q)
    along = scattered.longitudinal(fibre, profiles, pair.theta_i, pair.s_o, pair.phi)
    entering = np.divide(a, whole, out=np.zeros_like(a), where=whole > 0.0)
    return entering * part * along[..., None]


def pdf(
    fibre: Fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    h: ArrayLike,
    lobe: str | int,
    profiles: Profiles | None = None,
    sampling: str = "full-cdf",
) -> Array:
    """Solid-angle density with which a lobe at offset h chooses wi.

    Parameters
    ----------
    wo, wi : (..., 3)   unit vectors in the fibre's frame
    h : (...)           offset, [-1, 1]
    lobe                name or index
    sampling            "full-cdf": scattered lobes from their profiles; "attenuation-cdf",
                        "uniform-h": uniform on the sphere

    Returns
    -------
    (...) float64       [1/sr], integral 1 over the sphere

    Raises
    ------
    FibreError          unknown lobe or sampling, or a scattered lobe in "full-cdf" without profiles
    """
    if sampling not in ("uniform-h", "attenuation-cdf", "full-cdf"):
        raise FibreError(
            f"bcsdf: sampling {sampling!r} is not known - allowed are uniform-h, "
            "attenuation-cdf, full-cdf"
        )
    pair = _pair(fibre, wo, wi, h)
    return _density(fibre, pair, _lobe_name(lobe), profiles, sampling != "full-cdf")
