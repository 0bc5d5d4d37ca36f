"""A pair of directions at an offset, in the model's angles; names of lobes and samplers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.optics import LOBES, RESIDUAL, Geometry, geometry

Array = NDArray[np.float64]

SAMPLING = ("uniform-h", "attenuation-cdf", "full-cdf")
"""The ways to choose lobe, offset and direction that are written here."""


@dataclass(frozen=True)
class Pair:
    """wo and wi at an offset h, all of one shape: theta_i belongs to wo, theta_o and its sine s_o
    to wi, phi is the azimuth of wi from that of wo."""

    theta_i: Array
    theta_o: Array
    s_o: Array
    phi: Array
    h: Array
    geo: Geometry

    def phi_q(self, lobe: str) -> Array:
        """Azimuth of wi, seen from the ray that TTs or TRTs scatters where it enters the medulla;
        of the residual, after two reflections."""
        reflections = {"TTs": 0, "TRTs": 1, RESIDUAL: 2}[lobe]
        turned = reflections * (np.pi + 2.0 * self.geo.gamma_t)
        return self.phi - (self.geo.gamma_t - self.geo.gamma_i) - turned


def pair_of(fibre: Fibre, wo: ArrayLike, wi: ArrayLike, h: ArrayLike) -> Pair:
    """The pair of unit vectors wo and wi (..., 3) at h (...); FibreError if they are none."""
    known, other = unit_vectors("wo", wo), unit_vectors("wi", wi)
    theta_i, phi_i = angles(known)
    theta_o, phi_o = angles(other)
    theta_i, theta_o, s_o, phi, h = np.broadcast_arrays(
        theta_i, theta_o, other[..., 0], phi_o - phi_i, np.asarray(h, np.float64)
    )
    return Pair(theta_i, theta_o, s_o, phi, h, geometry(fibre, h, theta_i))


def angles(w: Array) -> tuple[Array, Array]:
    """Inclination and azimuth [rad] of vectors (..., 3)."""
    return np.arctan2(w[..., 0], np.hypot(w[..., 1], w[..., 2])), np.arctan2(w[..., 2], w[..., 1])


def unit_vectors(name: str, w: ArrayLike) -> Array:
    """(..., 3) float64 of length 1; FibreError where the length is off by more than rounding."""
    w = np.asarray(w, np.float64)
    if w.ndim == 0 or w.shape[-1] != 3 or not np.all(np.abs((w * w).sum(-1) - 1.0) <= 1e-3):
        raise FibreError(
            f"bcsdf: {name} has shape {w.shape} - allowed are unit vectors (..., 3) in the "
            "fibre's frame - normalise it; x is the tangent"
        )
    return w / np.sqrt((w * w).sum(-1, keepdims=True))


def lobe_name(lobe: str | int) -> str:
    """The name of a lobe given by name or index; FibreError if there is none."""
    names = (*LOBES, RESIDUAL)
    if isinstance(lobe, str) and lobe in names:
        return lobe
    if not isinstance(lobe, str) and 0 <= lobe < len(names):
        return names[lobe]
    raise FibreError(
        f"bcsdf: lobe {lobe!r} is not known - allowed are {', '.join(names)} or 0 to 5"
    )


def sampling_name(sampling: str) -> str:
    """`sampling` itself; FibreError unless it is one of SAMPLING."""
    if sampling not in SAMPLING:
        raise FibreError(
            f"bcsdf: sampling {sampling!r} is not known - allowed are {', '.join(SAMPLING)}"
        )
    return sampling
