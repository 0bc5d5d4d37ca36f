"""Brute-force Monte Carlo of one smooth fibre against the float64 reference."""

import fibre_walk
import numpy as np
import pytest
from fibre_oracles import flat_profiles
from fibre_walk import CLASSES, PHI_BINS, Truth, simulate

from furcl import bcsdf
from furcl.device.choice import Device
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles

PHOTONS = 8000


def _smooth(name: str) -> Fibre:
    """The preset as the walk sees it: a plain interface without tilt."""
    return Fibre.preset(name).replace(layers=0.5, alpha_deg=0.0)


def _energies_agree(fibre: Fibre, theta: float, truth: Truth) -> bool:
    """R, TT and TRT within 0.5 % in every channel; lobes below 1e-7 are not looked at."""
    model = bcsdf.lobe_albedos(fibre, theta, bcsdf.UNSCATTERED)
    return all(
        np.all(np.abs(truth.energy[k] - model[p]) <= 5e-3 * model[p] + 1e-7)
        for k, p in enumerate(("R", "TT", "TRT"))
    )


@pytest.mark.parametrize("degrees", [0, 30, 60, 80])
@pytest.mark.parametrize("name", ["human-white", "human-black", "raccoon", "red-fox", "brown"])
def test_unscattered_energies(name: str, degrees: float, seed: int) -> None:
    """Attenuation is right: what leaves unscattered is what light in a real cylinder does.

    The twin, a model whose cortex absorbs a little more, must fail: the comparison can see it.
    """
    fibre, theta = _smooth(name), np.radians(degrees)
    truth = simulate(fibre, theta, PHOTONS, seed)
    assert _energies_agree(fibre, theta, truth)
    darker = fibre.replace(sigma_ca=[1.05 * s + 0.02 for s in fibre.sigma_ca])
    assert not _energies_agree(darker, theta, truth)


@pytest.mark.parametrize("degrees", [0, 50])
@pytest.mark.parametrize("kappa", [0.4, 0.86])
def test_scattered_energy_without_absorption(kappa: float, degrees: float, seed: int) -> None:
    """Nothing is lost, and what scatters on the first or second crossing is the model's q E_p.

    How it leaves differs (the walk refracts, the model does not), its energy cannot. Five standard
    errors; the twin without the factor q is tens of them away.
    """
    fibre = Fibre(eta=1.5, kappa=kappa, sigma_ms=1.2, g=0.5, layers=0.5)
    theta = np.radians(degrees)
    truth = simulate(fibre, theta, PHOTONS, seed)
    model = bcsdf.lobe_albedos(fibre, theta, flat_profiles(), residual=True)
    trapped = truth.energy[CLASSES.index("trapped"), 0]
    error = float(np.linalg.norm(truth.error[:, 0]))
    assert truth.energy[:, 0].sum() == pytest.approx(1.0, abs=5 * error)
    for name in ("TTs", "TRTs"):
        k = CLASSES.index(name)
        tolerance = 5 * truth.error[k, 0] + trapped
        assert truth.energy[k, 0] == pytest.approx(model[name][0], abs=tolerance)
        dense = bcsdf.lobe_albedos(fibre.replace(sigma_ms=1e4), theta, flat_profiles())
        assert truth.energy[k, 0] != pytest.approx(dense[name][0], abs=tolerance)
    later = truth.energy[CLASSES.index("TRRT+"), 0] + truth.energy[CLASSES.index("TRRTs+"), 0]
    assert later == pytest.approx(model[bcsdf.RESIDUAL][0], abs=5 * error + trapped)


@pytest.mark.parametrize("lobe", [0, 1, 2])
def test_unscattered_azimuths(lobe: int, seed: int) -> None:
    """Far-field azimuths of R, TT and TRT: A_p(h) put where Phi_p(h) points, in 36 bins."""
    fibre, theta = _smooth("human-white"), 0.5
    truth = simulate(fibre, theta, 40 * PHOTONS, seed)
    found = truth.density[lobe].sum(0) * (2.0 / fibre_walk.S_BINS)
    h = 2 * (np.arange(400_000) + 0.5) / 400_000 - 1
    phi = np.mod(bcsdf.geometry(fibre, h, theta).Phi(lobe) + np.pi, 2 * np.pi)
    weight = bcsdf.attenuation(fibre, h, theta, bcsdf.UNSCATTERED)[CLASSES[lobe]].mean(-1) / h.size
    expected = np.histogram(phi, PHI_BINS, (0, 2 * np.pi), weights=weight)[0]
    expected *= PHI_BINS / (2 * np.pi)
    assert np.abs(found - expected).sum() < 0.01 * expected.sum()
    assert np.abs(np.roll(found, 1) - expected).sum() > 0.02 * expected.sum()


def test_scattered_shape_of_a_thin_matched_core(seed: int) -> None:
    """Index almost 1, thin isotropic core, theta = 0: scattered once, uniform on the sphere."""
    fibre = Fibre(eta=1.0001, kappa=0.9, sigma_ms=1e-4, g=0.0, layers=0.5)
    truth = simulate(fibre, 0.0, 40 * PHOTONS, seed)
    density = truth.density[CLASSES.index("TTs")]
    density = density / truth.energy[CLASSES.index("TTs")].mean()
    along, around = density.mean(1) * 2 * np.pi, density.mean(0) * 2
    assert along == pytest.approx(np.full(along.size, 0.5), rel=0.05)
    assert around == pytest.approx(np.full(around.size, 0.5 / np.pi), rel=0.05)


def test_same_seed_same_bits() -> None:
    first, second, other = (simulate(_smooth("raccoon"), 0.3, 800, s) for s in (5, 5, 6))
    assert np.array_equal(first.density, second.density)
    assert not np.array_equal(first.density, other.density)


MATCHED = Fibre(
    eta=1.0001, kappa=0.7, alpha_deg=0, sigma_ms=1.0, sigma_ma=(0.0, 0.3, 1.0), g=0.6, layers=0.5
)
"""Without refraction and cortex the model's scattered lobes make no approximation at theta = 0."""


def test_escape_of_a_matched_fibre(device: Device, seed: int) -> None:
    """The simulated profiles let out what a walk through the same medulla does, in each channel.

    Five standard errors and 0.3 %; the twin walks through a medulla that absorbs 5 % more.
    """
    model = bcsdf.lobe_albedos(MATCHED, 0.0, build_profiles(device, MATCHED, photons=4096))["TTs"]
    darker = MATCHED.replace(sigma_ma=(0.0, 0.315, 1.05))
    agree = []
    for fibre in (MATCHED, darker):
        truth = simulate(fibre, 0.0, 20 * PHOTONS, seed)
        energy, error = truth.energy[4], truth.error[4]
        agree.append(np.abs(energy - model) <= 5 * error + 3e-3 * energy)
    assert agree[0].all()
    assert not agree[1][1:].any()


@pytest.mark.parametrize("h", [0.3, -0.5])
def test_azimuths_of_a_matched_fibre(h: float, device: Device, seed: int) -> None:
    """Near field: the azimuths of scattered light on one side of the fibre, absorption included.

    The mirror image, a wrong sign of h or phi, must be farther away.
    """
    truth = simulate(MATCHED, 0.0, 10 * PHOTONS, seed, offsets=(h - 0.02, h + 0.02))
    found = truth.density[CLASSES.index("TTs")].mean(0) * 2.0
    profiles = build_profiles(device, MATCHED, photons=4096)
    phi = ((np.arange(8 * PHI_BINS) + 0.5) / (8 * PHI_BINS) * 2 - 1) * np.pi
    s = (np.arange(64) + 0.5) / 32 - 1
    grid_s, grid_phi = np.meshgrid(s, phi)
    c = np.sqrt(1 - grid_s**2)
    wi = np.stack([grid_s, c * np.cos(grid_phi), c * np.sin(grid_phi)], -1)
    value = bcsdf.evaluate(MATCHED, [0.0, 1.0, 0.0], wi, h, profiles, lobe="TTs").mean(-1)
    expected = value.mean(1).reshape(PHI_BINS, 8).mean(1) * 2.0
    distance = np.abs(found - expected).sum() / expected.sum()
    mirrored = np.abs(found[::-1] - expected).sum() / expected.sum()
    assert distance < 0.04
    assert mirrored > 5 * distance
