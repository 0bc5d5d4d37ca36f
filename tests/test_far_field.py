"""The float64 far field and the offsets at an azimuth: by more nodes, and by each other."""

import numpy as np
import pytest
from light_samples import directions
from offset_cells import wo_at

from furcl import bcsdf
from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.rendering.probe import Probe


@pytest.mark.parametrize("preset", ["human-white", "raccoon", "unlabelled-b"])
def test_nodes(device, preset):
    """8 times as many change R, TT and TRT by 1e-10, and scattered lobes, whose profiles have
    steps in phi, by 5e-4; 3e-12 and 3.4e-4 measured."""
    fibre = Fibre.preset(preset)
    profiles = Probe(fibre, device=device).material.profiles
    for theta in (0.0, 0.8, 1.5):
        for lobe in bcsdf.LOBES:
            few, many = (
                bcsdf.far_field(fibre, wo_at(theta), directions(theta), profiles, lobe, n=n)
                for n in (1024, 8192)
            )
            tolerance = 5e-4 if lobe in bcsdf.SCATTERED else 1e-10
            np.testing.assert_allclose(few, many, rtol=tolerance, atol=1e-12 * many.max())


@pytest.mark.parametrize("lobe", ["R", "TT", "TRT"])
@pytest.mark.parametrize("theta", [0.0, 1.0, -1.4])
def test_offsets_leave_at_their_azimuth(lobe, theta):
    fibre = Fibre(eta=1.5)
    found = [bcsdf.offsets_at_azimuth(fibre, theta, phi, lobe) for phi in np.linspace(-4, 4, 41)]
    for phi, h in zip(np.linspace(-4, 4, 41), found, strict=True):
        azimuth = bcsdf.geometry(fibre, h, theta).Phi(bcsdf.LOBES.index(lobe))
        np.testing.assert_allclose(np.exp(1j * azimuth), np.exp(1j * phi), atol=1e-11)
    numbers = {len(h) for h in found}
    # TRT turns back where 1 / eta' > 1/2.
    turns_back = np.cos(theta) / np.sqrt(1.5**2 - np.sin(theta) ** 2) > 0.5
    assert min(numbers) == (1 if lobe == "R" else 0)
    assert max(numbers) == (3 if lobe == "TRT" and turns_back else 1)


@pytest.mark.parametrize("lobe", ["R", "TT", "TRT"])
@pytest.mark.parametrize("phi", [0.5, 2.0, 2.9])
def test_a_smooth_fibre_sends_light_where_its_offsets_say(lobe, phi):
    """N_p of a narrow lobe is the sum of A_p / (2 |dPhi_p / dh|) over the offsets; 1e-3 measured
    of beta_n 0.1 degrees."""
    fibre = Fibre(eta=1.5, beta_n_deg=0.1, alpha_deg=0.0, layers=0.5, sigma_ca=(0.3, 0.3, 0.3))
    theta, p = 0.4, bcsdf.LOBES.index(lobe)
    wi = np.array([-np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)])
    far = bcsdf.far_field(fibre, wo_at(theta), wi, lobe=lobe, n=65_536)[0]
    mu, width = (-theta, fibre.beta_m * (0.5, 1.5)[p - 1]) if p else bcsdf.cone(fibre, theta, phi)
    h = bcsdf.offsets_at_azimuth(fibre, theta, phi, lobe)
    step = 1e-6
    turned = [bcsdf.geometry(fibre, h + side, theta).Phi(p) for side in (-step, step)]
    slope = np.abs(turned[1] - turned[0]) / (2.0 * step)
    energy = bcsdf.attenuation(fibre, h, theta)[lobe][:, 0]
    expected = np.sum(energy / (2.0 * slope)) * bcsdf.m_p(wi[0], mu, width**2)
    assert far == pytest.approx(expected, rel=5e-3, abs=1e-12)


def test_no_offsets_of_a_scattered_lobe():
    with pytest.raises(FibreError, match="leaves at every azimuth - allowed are R, TT, TRT"):
        bcsdf.offsets_at_azimuth(Fibre(), 0.0, 1.0, "TTs")
