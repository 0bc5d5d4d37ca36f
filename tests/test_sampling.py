"""Chi-square of every sampler against its own density, each with a mutant that must fail.

For every lobe the joint density of (h, phi, s) that Probe.pdf states is integrated over cells and
compared with the counts of Probe.sample; (h, phi) is folded by its symmetry to h >= 0.
"""

import numpy as np
import pytest
from direction_statistics import chi_square_p, sidak
from fibres import FIBRES
from model_checks import SAMPLERS, check_samples_follow_their_density
from offset_cells import resolved, wo_at

from furcl import bcsdf
from furcl.fibre.double_cylinder.reference.angles import centre_and_width
from furcl.rendering.probe import Probe

CASES = [
    (fibre, theta_deg, sampling)
    for sampling in SAMPLERS
    for fibre, theta_deg in [("raccoon", 20.0), ("coloured", -65.0), ("all medulla", 40.0)]
]
LEVEL = sidak(5 * len(CASES))


@pytest.mark.statistical
@pytest.mark.parametrize(("name", "theta_deg", "sampling"), CASES)
def test_chi_square(device, seed, name, theta_deg, sampling):
    probe = Probe(FIBRES[name], sampling=sampling, device=device)
    check_samples_follow_their_density(probe, np.deg2rad(theta_deg), seed, LEVEL, resolved)


NARROW = [(1.1e-3, 1.1e-3), (0.02, 0.3), (0.5, 0.05), (1.5, 2.4)]


@pytest.mark.statistical
@pytest.mark.parametrize(("beta_m", "beta_n"), NARROW)
@pytest.mark.parametrize("theta_deg", [0.0, 60.0, 89.0])
def test_unscattered_lobes_follow_the_reference(device, seed, beta_m, beta_n, theta_deg):
    """For widths that no grid of cells resolves: s and phi put through the reference's own
    distribution functions must be uniform."""
    fibre = FIBRES["clear"].replace(
        beta_m_deg=np.rad2deg(beta_m), beta_n_deg=np.rad2deg(beta_n),
        alpha_deg=4.0,
    )  # fmt: skip
    probe = Probe(fibre, sampling="attenuation-cdf", device=device)
    theta = np.deg2rad(theta_deg)
    wi, h, lobe, _, _ = probe.sample(wo_at(theta), n=150_000, seed=seed % 2**32)
    level = sidak(2 * 3 * 3 * len(NARROW))
    geometry = bcsdf.geometry(fibre, h.astype(np.float64), np.full(len(h), theta))
    phi = np.arctan2(wi[:, 2], wi[:, 1]).astype(np.float64)
    for p in range(3):
        mine = lobe == p
        if mine.sum() < 500:
            continue
        u_phi = _wrapped_normal_cdf(phi[mine] - geometry.Phi(p)[mine], beta_n * np.sqrt(p + 1))
        assert _uniform_p(u_phi) > level
        assert mine.sum() < 10_000 or _uniform_p(u_phi**1.1) < level, "azimuths bent by 10 %"
        if beta_m >= 0.02 and theta_deg < 80:  # float32 directions resolve the lobe
            u_s = _longitudinal_cdf(fibre, p, theta, phi[mine], wi[mine, 0].astype(np.float64))
            assert _uniform_p(u_s) > level
            assert _uniform_p(u_s**1.1) < level, "a distribution bent by 10 %"


def _uniform_p(u, bins=20):
    counts = np.histogram(u, bins=bins, range=(0, 1))[0]
    return chi_square_p(counts, np.full(bins, len(u) / bins))


def _wrapped_normal_cdf(angle, beta):
    """Distribution of a wrapped Gaussian on [-pi, pi) around 0."""
    from scipy import stats

    x = np.mod(angle + np.pi, 2 * np.pi) - np.pi
    turns = 2 * np.pi * np.arange(-4, 5)
    below = stats.norm.cdf((x[:, None] + turns) / beta) - stats.norm.cdf((-np.pi + turns) / beta)
    return below.sum(axis=1)


def _longitudinal_cdf(fibre, p, theta, phi, s):
    """Distribution in s by the trapezoid rule on the reference's density, row by row."""
    out = np.empty(len(s))
    rows = np.arange(len(s)) if p == 0 else np.zeros(len(s), int)
    nodes = np.linspace(-1, 1, 4001)
    cache = {}
    for i, row in enumerate(rows):
        # R depends on phi: a grid of 200 azimuths is fine enough for 20 bins.
        key = int(np.abs(phi[i]) / np.pi * 200) if p == 0 else int(row)
        if key not in cache:
            centre = (key + 0.5) / 200 * np.pi if p == 0 else 0.0
            mu, beta = centre_and_width(fibre, p, np.float64(theta), np.float64(centre))
            density = bcsdf.m_p(nodes, mu, beta * beta)
            steps = 0.5 * (density[1:] + density[:-1]) * (nodes[1] - nodes[0])
            cache[key] = np.concatenate([[0], np.cumsum(steps)])
        out[i] = np.interp(s[i], nodes, cache[key])
    return np.clip(out, 0, 1)
