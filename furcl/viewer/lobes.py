"""The lobes of a fibre as curves, from the model's float64 reference."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.model import model_of

Array = NDArray[np.float64]

#: Azimuths from 0, straight back, to pi, straight through, and inclinations of the curves.
N_PHIS = 49
N_THETAS = 61
#: Nodes of the integrals over the offset, the inclination and the azimuth.
N_OFFSETS = 48
N_INCLINATIONS = 40
N_AZIMUTHS = 24

WO = np.array([0.0, 1.0, 0.0])


def curves(fibre: Any, prepared: Any = None, *, residual: bool = False) -> dict[str, Any]:
    """What a fibre sends where, for light across it (theta = 0), lobe by lobe.

    Curves are means of the three channels. Sums of some nodes each, to be looked at:
    tests/test_view_lobes.py has how near they are to the reference's energies.

    Parameters
    ----------
    prepared : object       what the model prepared (`FibreModel.prepare`), or stands for it
    residual : bool         with the lobe of all later orders, if the model leaves it out

    Returns
    -------
    dict    phi (49) [rad]; theta (61) [rad], dense around 0, negative towards the root; lobes:
            name -> N, the density of energy in phi [1/rad] (49); M, that in theta [1/rad] (61);
            energy (r, g, b), the part of the light that leaves in it; albedo (r, g, b), their sum
    """
    model = model_of(fibre)
    reference = import_module(model.reference)
    h, weight = _gauss(N_OFFSETS, -0.5 * np.pi, 0.5 * np.pi) if model.has_offset else _one()
    h, weight = np.sin(h), 0.5 * weight * np.cos(h) if model.has_offset else weight
    names = reference.attenuation(fibre, h, 0.0, prepared, residual=residual)
    phi = np.linspace(0.0, np.pi, N_PHIS)
    even = np.linspace(-1.0, 1.0, N_THETAS)
    theta = 0.5 * np.pi * np.sign(even) * np.abs(even) ** 1.7
    inclination, of_inclination = _around_zero(N_INCLINATIONS)
    azimuth = (np.arange(N_AZIMUTHS) + 0.5) * (2.0 * np.pi / N_AZIMUTHS)
    around = _directions(phi[:, None], inclination)
    along = _directions(azimuth[:, None], theta)
    lobes = {}
    for name in names:

        def value(wi: Array, name: str = name) -> Array:
            found = reference.evaluate(fibre, WO, wi[..., None, :], h, prepared, lobe=name)
            return np.einsum("...hc,h->...c", found, weight)

        # Solid angle is ds dphi, ds = cos(theta) dtheta.
        of_phi = np.einsum("ptc,t->pc", value(around), of_inclination * np.cos(inclination))
        of_theta = value(along).mean(axis=(0, 2)) * 2.0 * np.pi * np.cos(theta)
        lobes[name] = {
            "N": of_phi.mean(axis=1).tolist(),
            "M": of_theta.tolist(),
            "energy": (2.0 * np.trapezoid(of_phi, phi, axis=0)).tolist(),
        }
    albedo = np.sum([lobe["energy"] for lobe in lobes.values()], axis=0)
    return {
        "phi": phi.tolist(),
        "theta": theta.tolist(),
        "lobes": lobes,
        "albedo": albedo.tolist(),
    }


def _directions(phi: NDArray[np.floating], theta: NDArray[np.floating]) -> Array:
    """Unit vectors (phis, thetas, 3) at azimuths from WO."""
    x = np.broadcast_to(np.sin(theta), np.broadcast_shapes(phi.shape, theta.shape))
    return np.stack([x, np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], axis=-1)


def _gauss(n: int, low: float, high: float) -> tuple[Array, Array]:
    x, w = np.polynomial.legendre.leggauss(n)
    half = 0.5 * (high - low)
    return low + half * (x + 1.0), half * w


def _one() -> tuple[Array, Array]:
    return np.zeros(1), np.ones(1)


def _around_zero(n: int) -> tuple[Array, Array]:
    """Inclinations that are dense around 0, where narrow lobes are, and their weights [rad]."""
    u, w = _gauss(n // 2, 0.0, 1.0)
    theta, weight = 0.5 * np.pi * u**3, 0.5 * np.pi * 3.0 * u**2 * w
    return np.concatenate([-theta[::-1], theta]), np.concatenate([weight[::-1], weight])
