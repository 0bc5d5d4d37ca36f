"""The far field towards a direction, and the offsets whose light leaves a smooth fibre there."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.energy import nodes_over_h
from furcl.fibre.double_cylinder.reference.model import evaluate
from furcl.fibre.double_cylinder.reference.optics import LOBES, geometry
from furcl.fibre.double_cylinder.reference.pairs import lobe_name, unit_vectors
from furcl.fibre.double_cylinder.reference.profiles import MedullaData

Array = NDArray[np.float64]


def far_field(
    fibre: Fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    profiles: MedullaData = None,
    lobe: str | int | None = None,
    residual: bool = False,
    n: int = 1024,
) -> Array:
    """Mean of `evaluate` over the offset h in [-1, 1]: the sum of N_p m_p.

    Parameters
    ----------
    wo : (3,)           unit vector in the fibre's frame: known direction
    wi : (..., 3)       other directions
    profiles, lobe, residual    as for `evaluate`
    n : int             nodes over |h|, a multiple of 16

    Returns
    -------
    (..., 3) float64    [1/sr]; of presets within 1e-10 of what 8 times as many nodes say, and of
                        scattered lobes, whose profiles have steps in phi, within 5e-4
                        (test_far_field.py::test_nodes)
    """
    wo, wi = unit_vectors("wo", wo), unit_vectors("wi", wi)
    theta = float(np.arctan2(wo[0], np.hypot(wo[1], wo[2])))
    h, weight, _ = nodes_over_h(fibre, theta, n // 16, 16)
    h, weight = h.ravel(), weight.ravel()
    total = np.zeros((*wi.shape[:-1], 3))
    for side in (h, -h):
        values = evaluate(fibre, wo, wi[..., None, :], side, profiles, lobe, residual)
        total += 0.5 * np.einsum("n,...nc->...c", weight, values)
    return total


def offsets_at_azimuth(fibre: Fibre, theta: float, phi: float, lobe: str | int) -> Array:
    """All offsets h whose ray leaves a smooth fibre at the azimuth phi in R, TT or TRT.

    Parameters
    ----------
    theta : float       inclination of the known direction [rad], [-pi/2, pi/2]
    phi : float         azimuth [rad], any
    lobe                name or index

    Returns
    -------
    (roots,) float64    the roots of Phi_p(h) = phi (modulo a turn), in rising order: one for R,
                        none or one for TT, none to three for TRT; each to 1e-12 in asin(h)

    Raises
    ------
    FibreError          a lobe that the medulla scatters
    """
    name = lobe_name(lobe)
    if name not in LOBES[:3]:
        raise FibreError(
            f"bcsdf: lobe {name!r} leaves at every azimuth - allowed are {', '.join(LOBES[:3])}"
        )
    p = LOBES.index(name)

    def off(gamma: Array) -> Array:
        """sin of half the angle between Phi_p and phi: of both signs around each root."""
        azimuth = geometry(fibre, np.sin(gamma), theta).Phi(p)
        return np.sin(0.5 * (azimuth - phi))

    gamma = np.linspace(-np.pi / 2, np.pi / 2, 4097)
    value = off(gamma)
    cell = np.flatnonzero((value[:-1] < 0.0) != (value[1:] < 0.0))
    low, high, sign = gamma[cell], gamma[cell + 1], np.sign(value[cell])
    for _ in range(50):
        middle = 0.5 * (low + high)
        same = np.sign(off(middle)) == sign
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.sin(0.5 * (low + high))
