"""Medulla profiles against an analog walk, quadrature and their own invariants."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from direction_statistics import sidak
from medulla_reference import leave
from scipy import integrate, stats

from furcl.device.choice import Device
from furcl.fibre.double_cylinder.medulla_walk import (
    OPTICAL_RADIUS_CAP,
    Tally,
    make_plan,
    simulate,
    tau_nodes,
)
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles

PHOTONS = 64 * 48
ANALOG = 400_000
CASES = {
    "forward": Fibre.preset("red-fox", sigma_ma=(0.05, 0.5, 3.0)),
    "backward": Fibre(eta=1.2, kappa=0.7, sigma_ms=1.0, g=-0.5, sigma_ma=(0.1, 1.0, 8.0)),
    "dense": Fibre(eta=1.5, kappa=1.0, sigma_ms=6.0, g=0.1, sigma_ma=(0.02, 0.2, 2.0)),
    "thin": Fibre(eta=1.3, kappa=0.4, sigma_ms=0.5, g=0.6, sigma_ma=(0.3, 3.0, 30.0)),
}
AZIMUTH_ROWS = ((0, 0), (1, 14), (3, 24), (2, 29))
LONGITUDINAL_ROWS = (0, 7, 13)


@functools.cache
def tally_of(device: Device, case: str) -> Tally:
    return simulate(device, CASES[case], 1, PHOTONS)


def ratio(parts: np.ndarray, whole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate and standard error of parts / whole from batches: (B, k) and (B,)."""
    batches = len(whole)
    value = parts.sum(0) / whole.sum()
    spread = parts - value * whole[:, None]
    return value, np.sqrt((spread**2).sum(0) * batches / (batches - 1)) / whole.sum()


def mean(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard error of the columns."""
    return values.mean(0), values.std(0) / np.sqrt(len(values))


def z_scores(ours: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> list:
    return list((ours[0] - other[0]) / np.hypot(ours[1], other[1]))


def azimuth_z(device: Device, case: str, g_shift: float, absorbing: bool) -> np.ndarray:
    """z scores of octants of Dhat and of the escaping shares, over AZIMUTH_ROWS."""
    fibre = CASES[case]
    sums = tally_of(device, case).azimuth.reshape(4, 32, 64, 4, 128)
    z = []
    for i, (tau_node, h_node) in enumerate(AZIMUTH_ROWS):
        stretch = fibre.kappa / tau_nodes(fibre)[tau_node]
        h = np.sin(h_node / 31 * np.pi / 2)
        tau, g = stretch * fibre.sigma_ms, fibre.g + g_shift
        phi, _, length, collisions = leave(tau, g, h, 0.0, ANALOG, np.random.default_rng(10 + i))
        hit = collisions > 0
        octant = np.minimum((phi[hit] + np.pi) // (np.pi / 4), 7)
        absorb = stretch * np.asarray(fibre.sigma_ma) * absorbing
        analog = np.column_stack(
            [octant[:, None] == np.arange(8), np.exp(-absorb * length[hit, None])]
        )
        row = sums[tau_node, h_node]
        parts = np.concatenate([row[:, 0].reshape(64, 8, 16).sum(2), row[:, 1:].sum(2)], axis=1)
        z += z_scores(ratio(parts, row[:, 0].sum(1)), mean(analog))
    return np.abs(z)


def longitudinal_z(device: Device, case: str, g_shift: float) -> np.ndarray:
    """z scores of eight coarse bins of s in both bands, over LONGITUDINAL_ROWS."""
    fibre = CASES[case]
    sums = tally_of(device, case).longitudinal.reshape(16, 2, 64, 64)
    z = []
    for i, node in enumerate(LONGITUDINAL_ROWS):
        theta = node / 15 * np.pi / 2
        tau, g = fibre.kappa * fibre.sigma_ms, fibre.g + g_shift
        phi, s, _, collisions = leave(tau, g, 2.0, theta, ANALOG, np.random.default_rng(20 + i))
        for band, centre in enumerate((0.0, np.pi)):
            inside = (collisions > 0) & (np.abs(np.abs(phi) - centre) < np.pi / 8)
            analog = ((s[inside] + 1.0) // 0.25)[:, None] == np.arange(8)
            # Coarse bins of fewer than 50 photons are not normal.
            full = analog.sum(0) >= 50
            ours = ratio(
                sums[node, band].reshape(64, 8, 8).sum(2)[:, full], sums[node, band].sum(1)
            )
            z += z_scores(ours, mean(analog[:, full]))
    return np.abs(z)


def limit(count: int) -> float:
    """|z| that the largest of `count` truths in each of the cases exceeds with chance 0.01."""
    return float(stats.norm.isf(0.5 * sidak(count * len(CASES))))


@pytest.mark.statistical
@pytest.mark.parametrize("case", CASES)
def test_azimuth_agrees_with_the_analog_walk(device, case):
    z = azimuth_z(device, case, 0.0, True)
    assert z.max() < limit(len(z))


@pytest.mark.statistical
@pytest.mark.parametrize(("g_shift", "absorbing"), [(0.02, True), (0.0, False)])
@pytest.mark.parametrize("case", CASES)
def test_azimuth_disagrees_with_a_walk_of_another_material(device, case, g_shift, absorbing):
    z = azimuth_z(device, case, g_shift, absorbing)
    assert z.max() > limit(len(z))


@pytest.mark.statistical
@pytest.mark.parametrize("case", CASES)
def test_longitudinal_agrees_with_the_analog_walk(device, case):
    z = longitudinal_z(device, case, 0.0)
    assert z.max() < limit(len(z))


@pytest.mark.statistical
@pytest.mark.parametrize("case", CASES)
def test_longitudinal_disagrees_with_a_walk_of_another_material(device, case):
    z = longitudinal_z(device, case, 0.03)
    assert z.max() > limit(len(z))


@pytest.mark.statistical
def test_analog_walk_crosses_undisturbed_as_often_as_it_must():
    """The reference itself: the chance of no collision is exp(-2 tau sqrt(1 - h^2))."""
    collisions = leave(0.8, 0.3, 0.6, 0.0, ANALOG, np.random.default_rng(5))[3]
    p = np.exp(-2 * 0.8 * 0.8)
    z = ((collisions == 0).mean() - p) / np.sqrt(p * (1 - p) / ANALOG)
    assert abs(z) < stats.norm.isf(0.005)


def hg(cosine, g):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


@pytest.mark.parametrize("g", [0.0, 0.7, -0.9])
def test_thin_medulla_scatters_once(device, g):
    """tau -> 0: the profiles are the phase function alone, whatever h is."""
    profiles = build_profiles(
        device, Fibre(kappa=0.5, sigma_ms=1e-7, g=g), photons=64 * 64, cache=False
    )
    assert profiles is not None
    for bin_index in (0, 20, 64, 100):
        phi = -np.pi + (bin_index + 0.5) * np.pi / 64
        exact = integrate.quad(
            lambda s, phi=phi: hg(-np.sqrt(1 - s * s) * np.cos(phi), g), -1, 1, epsabs=1e-10
        )[0]
        error = profiles.azimuth.relative_error[..., bin_index]
        off = np.abs(profiles.azimuth.density[..., bin_index] / exact - 1)
        # The mean over the bin differs from its middle by less than 1 %.
        assert (off < 5 * error + 0.01).all()
    for node, bin_index in ((0, 31), (5, 10), (10, 60)):
        theta, s = node / 15 * np.pi / 2, -1 + (bin_index + 0.5) / 32
        for band, centre in enumerate((0.0, np.pi)):

            def at(phi, s, theta=theta):
                across = -np.cos(theta) * np.sqrt(1 - s * s) * np.cos(phi)
                return hg(across - np.sin(theta) * s, g)

            bounds = (centre - np.pi / 8, centre + np.pi / 8)
            whole = integrate.dblquad(at, -1, 1, *bounds, epsabs=1e-9)[0]
            exact = integrate.quad(at, *bounds, args=(s,))[0] / whole
            error = profiles.longitudinal.relative_error[node, band, bin_index]
            found = profiles.longitudinal.density[node, band, bin_index]
            assert abs(found / exact - 1) < 5 * error + 0.01


EXTREMES = {
    "dense": {"kappa": 1, "sigma_ms": 1e4, "eta": 1.0001},
    "dense backward": {"kappa": 1, "sigma_ms": 1e4, "g": -0.99, "eta": 3, "sigma_ma": 1e4},
    "narrow": {"kappa": 1, "sigma_ms": 5, "g": 0.99, "eta": 1.5, "sigma_ma": (0, 1e4, 1)},
    "backward": {"kappa": 0.5, "sigma_ms": 1e-3, "g": -0.99, "sigma_ma": (1e4, 1e4, 1)},
    "faint": {"kappa": 1e-20, "sigma_ms": 1e-20, "g": 0.5},
    "small": {"kappa": 1e-6, "sigma_ms": 1, "g": 0.5, "sigma_ma": (0, 1, 1e4)},
}


@pytest.mark.parametrize("name", EXTREMES)
def test_tables_are_densities_for_any_material(device, name):
    """Exact at any number of photons: finite, >= 0, normalised, ends of CDFs, absorption <= 1."""
    profiles = build_profiles(device, Fibre(**EXTREMES[name]), photons=64, cache=False)
    assert profiles is not None
    packed = profiles.pack()
    assert packed.dtype == np.float32
    assert np.isfinite(packed).all()
    assert (packed >= 0).all()
    assert profiles.given_up == 0.0
    for table, width in ((profiles.azimuth, np.pi / 64), (profiles.longitudinal, 1 / 32)):
        total = table.density.astype(np.float64).sum(-1) * width
        np.testing.assert_allclose(total, 1, atol=1e-6)
        np.testing.assert_allclose(np.diff(table.cdf), table.density[..., 1:] * width, atol=1e-6)
        assert (np.diff(table.cdf) >= 0).all()
        assert (table.cdf[..., -1] == 1.0).all()
    if profiles.escape is not None:
        assert profiles.azimuth.absorption is not None
        assert (profiles.azimuth.absorption <= 1).all()
        assert (profiles.escape <= 1 + 1e-6).all()
        shares = profiles.azimuth.density[..., None] * profiles.azimuth.absorption
        np.testing.assert_allclose(profiles.escape, shares.sum(2) * np.pi / 64, atol=1e-5)


@pytest.mark.parametrize("fibre", [Fibre(kappa=0.0, sigma_ms=2.0), Fibre(kappa=0.5, sigma_ms=0.0)])
def test_no_profiles_without_scattering(device, fibre):
    assert build_profiles(device, fibre, cache=False) is None


@pytest.mark.statistical
@pytest.mark.parametrize("case", CASES)
def test_centre_row_is_symmetric(device, case):
    """h = 0 knows no side: Dhat(phi) = Dhat(-phi) within its errors."""
    row = tally_of(device, case).azimuth[0, :, 0]
    halves = row[:, :64].reshape(64, 8, 8).sum(2) - row[:, :63:-1].reshape(64, 8, 8).sum(2)
    value, error = ratio(halves, row.sum(1))
    assert np.abs(value / error).max() < limit(8)


@pytest.mark.parametrize(
    "name", ["human-white", "raccoon", pytest.param("red-fox", marks=pytest.mark.slow)]
)
def test_presets_meet_their_noise_and_size(device, name):
    profiles = build_profiles(device, Fibre.preset(name), cache=False)
    assert profiles is not None
    assert profiles.relative_error < 0.02
    assert profiles.given_up == 0.0
    assert profiles.pack(3).nbytes <= 300_000  # three channels of absorption are the most


@pytest.mark.statistical
def test_stated_errors_are_those_between_seeds(device):
    """Differences of two seeds are as large as both state: ratio of squares near 1."""
    fibre = CASES["dense"]
    one, two = (build_profiles(device, fibre, seed=s, photons=64 * 16, cache=False) for s in (3, 4))
    assert one is not None
    assert two is not None
    for a, b in ((one.azimuth, two.azimuth), (one.longitudinal, two.longitudinal)):
        stated = np.hypot(a.relative_error * a.density, b.relative_error * b.density)
        squares = ((a.density - b.density) / stated) ** 2
        assert 0.8 < squares.mean() < 1.25


def test_plan_keeps_the_albedo_of_a_capped_medulla():
    fibre = Fibre(kappa=1.0, sigma_ms=1e4, sigma_ma=(1.0, 10.0, 100.0), g=0.5)
    rows = make_plan(fibre).azimuth
    np.testing.assert_allclose(rows[:, 0], 2 * OPTICAL_RADIUS_CAP)
    np.testing.assert_allclose(
        rows[:, 1:4] / rows[:, :1], [[1e-4, 1e-3, 1e-2]] * len(rows), rtol=1e-6
    )
