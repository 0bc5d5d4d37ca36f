"""Lobe shares of the presets: those of the paper, and those with which a render picks lobes."""

from typing import Any

import numpy as np
import pytest

from furcl import bcsdf
from furcl.device.choice import Device
from furcl.fibre.double_cylinder.paper import LOBE_SHARES
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles
from furcl.rendering.probe import Probe

# Points of a hundred by which a share may differ from the paper's. Measured, R to TRTs:
#   human-black  95.75  0.96 0.000  3.29 0.000
#   human-white  14.50 32.87 1.065 51.21 0.360
#   raccoon      14.61 16.64 0.829 67.01 0.914
# The paper samples its own inclinations and bins; TT of black hair and TRTs stay away from it.
BOUNDS = {
    "human-black": (2.2, 2.2, 0.01, 0.1, 0.01),
    "human-white": (1.9, 1.3, 0.1, 0.9, 1.5),
    "raccoon": (0.2, 1.0, 0.25, 0.3, 0.9),
}

# What the fit chose, changed by a twentieth or a fifth. The cortex of the raccoon is almost clear.
OTHERS = [
    (name, parameter, factor)
    for name in LOBE_SHARES
    for parameter, factor in (
        ("kappa", 1.05),
        ("sigma_ms", 1.2),
        ("sigma_ca", 1.2),
        ("layers", 1.2),
    )
    if (name, parameter) != ("raccoon", "sigma_ca")
] + [("raccoon", "sigma_ma", 1.2)]


def _shares(device: Device, fibre: Fibre) -> np.ndarray:
    """Percentages of R to TRTs. Few photons: they move by 0.01 against the tables of a render."""
    profiles = build_profiles(device, fibre, photons=384, cache=False)
    shares = bcsdf.lobe_shares(fibre, profiles)
    return np.array([100 * shares[lobe] for lobe in bcsdf.LOBES])


def _fits_the_paper(device: Device, name: str, fibre: Fibre) -> bool:
    difference = np.abs(_shares(device, fibre) - LOBE_SHARES[name])
    return bool(np.all(difference <= BOUNDS[name]))


@pytest.mark.parametrize("name", LOBE_SHARES)
def test_shares_of_the_paper(device: Device, name: str) -> None:
    assert _fits_the_paper(device, name, Fibre.preset(name))


@pytest.mark.parametrize(("name", "parameter", "factor"), OTHERS)
def test_another_fibre_does_not_fit(
    device: Device, name: str, parameter: str, factor: float
) -> None:
    """Mutants: every parameter of the fit matters."""
    fibre = Fibre.preset(name)
    changed: Any = {parameter: np.multiply(getattr(fibre, parameter), factor)}
    assert not _fits_the_paper(device, name, fibre.replace(**changed))


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["red-fox", "raccoon", "unlabelled-b"])
def test_lobes_are_picked_in_their_shares(device: Device, rng: np.random.Generator, name: str):
    """The float64 quadrature over inclinations and offsets against samples of a device.

    Four standard errors, a hundredth of the share for the lifted bins of the tables, and the
    ten-thousandth that each bin of a lobe has at least. A fibre whose cuticle is a fifth thicker
    must be seen.
    """
    fibre = Fibre.preset(name)
    probe = Probe(fibre, sampling="attenuation-cdf", device=device)
    wo = _isotropic_fibres(rng, 1 << 18)
    _, _, lobe, _, _ = probe.sample(wo, seed=5)
    picked = np.bincount(lobe, minlength=len(bcsdf.LOBES)) / len(wo)
    error = np.sqrt(picked * (1.0 - picked) / len(wo))

    def agree(other: Fibre) -> bool:
        found = bcsdf.lobe_shares(other, probe.material.profiles)
        shares = np.array([found[lobe] for lobe in bcsdf.LOBES])
        return bool(np.all(np.abs(picked - shares) < 4.0 * error + 0.01 * shares + 1e-4))

    assert agree(fibre)
    assert not agree(fibre.replace(layers=1.2 * fibre.layers))


def _isotropic_fibres(rng: np.random.Generator, n: int) -> np.ndarray:
    """Directions (n, 3) in the frames of fibres of any orientation, as often as they are seen: the
    square of the cosine of the inclination, by rejection."""
    theta = rng.uniform(-np.pi / 2, np.pi / 2, 3 * n)
    theta = theta[rng.random(3 * n) < np.cos(theta) ** 2][:n]
    phi = rng.uniform(-np.pi, np.pi, n)
    c = np.cos(theta)
    return np.stack([np.sin(theta), c * np.cos(phi), c * np.sin(phi)], axis=1)
