"""The float64 reference: densities over directions, their integrals and their limits."""

from itertools import pairwise

import numpy as np
import pytest
from fibre_oracles import flat_profiles, random_profiles

from furcl import bcsdf
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.oracle.mp_reference import exact_longitudinal

MODERATE = Fibre(
    eta=1.5, kappa=0.7, alpha_deg=3, beta_m_deg=15, beta_n_deg=20, sigma_ca=(0.1, 0.3, 0.9),
    sigma_ms=1.5, sigma_ma=(0.3, 0.2, 0.1), g=0.5, layers=0.7,
)  # fmt: skip


@pytest.mark.parametrize("v", [1e-6, 1e-4, 1e-2, 0.0834, 0.11, 0.5, 2.0, 6.0])
@pytest.mark.parametrize("mu", [-1.9, -1.57, -0.7, 0.0, 0.3, 1.2, 1.5705, 2.5])
def test_longitudinal_integral(v: float, mu: float) -> None:
    """Integral over s is 1 for a centre anywhere, also beyond the pole."""
    folded = np.arcsin(np.sin(mu))
    reach = 12 * np.sqrt(v)
    cuts = np.clip([folded - reach, folded - reach / 4, folded, folded + reach / 4, folded + reach],
                   -np.pi / 2, np.pi / 2)  # fmt: skip
    cuts = np.unique(np.concatenate([[-np.pi / 2, np.pi / 2], cuts]))
    x, w = np.polynomial.legendre.leggauss(80)
    total = 0.0
    for a, b in pairwise(cuts):
        theta = a + (b - a) * 0.5 * (x + 1)
        total += (w * 0.5 * (b - a) * np.cos(theta)) @ bcsdf.m_p(np.sin(theta), mu, v)
    assert total == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("v", [1e-6, 1e-3, 0.1, 3.0])
def test_longitudinal_against_60_digits(v: float) -> None:
    """The defining csch form, which overflows in float64, at 60 digits."""
    for mu in (-1.2, 0.0, 0.9):
        for shift in (-3.0, -0.5, 0.0, 1.0):
            theta = float(np.clip(mu + shift * np.sqrt(v), -1.5, 1.5))
            exact = exact_longitudinal(theta, mu, v)
            assert float(bcsdf.m_p(np.sin(theta), mu, v)) == pytest.approx(float(exact), rel=1e-8)


@pytest.mark.parametrize("beta_n_deg", [0.06, 1.0, 20.0, 90.0, 143.0])
@pytest.mark.parametrize("p", [0, 1, 2])
def test_azimuthal_integral(p: int, beta_n_deg: float) -> None:
    fibre = Fibre(beta_n_deg=beta_n_deg)
    n = 200_000
    phi = (np.arange(n) + 0.5) / n * 2 * np.pi + 40.0
    assert bcsdf.D_p(fibre, p, phi).mean() * 2 * np.pi == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("beta_n_deg", [20.0, 57.0, 143.0])
def test_azimuthal_against_fourier_series(beta_n_deg: float) -> None:
    """A wrapped normal density is 1/2pi (1 + 2 sum exp(-k^2 beta^2 / 2) cos(k delta))."""
    fibre = Fibre(beta_n_deg=beta_n_deg)
    delta = np.linspace(-9, 9, 301)
    k = np.arange(1, 60)[:, None]
    series = 1 + 2 * (np.exp(-0.5 * (k * fibre.beta_n) ** 2) * np.cos(k * delta)).sum(0)
    assert np.allclose(bcsdf.D_p(fibre, 0, delta), series / (2 * np.pi), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("theta", [-1.5, -0.4, 0.0, 0.9, 1.5])
def test_cone(theta: float) -> None:
    """phi = 0: shifted by twice the tilt towards the root, width sqrt2 beta_m; phi = pi: narrow."""
    fibre = Fibre(alpha_deg=3, beta_m_deg=6)
    mu, beta = bcsdf.cone(fibre, theta, [0.0, np.pi, -np.pi, 2 * np.pi])
    assert np.sin(mu[0]) == pytest.approx(np.sin(-theta - 2 * fibre.alpha), abs=1e-12)
    assert mu[3] == pytest.approx(mu[0])
    assert beta == pytest.approx([np.sqrt(2) * fibre.beta_m, 1e-3, 1e-3, np.sqrt(2) * fibre.beta_m])
    flat, _ = bcsdf.cone(fibre.replace(alpha_deg=0), theta, np.linspace(-3, 3, 7))
    assert flat == pytest.approx(np.full(7, -theta))


def test_highlights_move_apart_along_the_fibre() -> None:
    """R towards the root, TT and TRT towards the tip."""
    fibre = Fibre(alpha_deg=4, beta_m_deg=2, beta_n_deg=10, kappa=0)
    theta_i = 0.3
    wo = [np.sin(theta_i), np.cos(theta_i), 0.0]
    theta = np.linspace(-1.5, 1.5, 6001)
    for p, shift in ((0, -8), (1, 4), (2, 12)):
        phi = float(bcsdf.geometry(fibre, 0.2, theta_i).Phi(p))
        wi = np.stack([np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], 1)
        value = bcsdf.evaluate(fibre, wo, wi, 0.2, lobe=p)[:, 0]
        peak = np.degrees(theta[value.argmax()])
        assert peak == pytest.approx(np.degrees(-theta_i) + shift, abs=0.5)


def _sphere(fibre: Fibre, theta_i: float, h: float, lobe: str) -> tuple[np.ndarray, np.ndarray]:
    """Directions on the sphere and weights, aligned with the bins of the lobe's profile."""
    geo = bcsdf.geometry(fibre, h, theta_i)
    start = 0.0
    if lobe in ("TTs", "TRTs"):
        start = float(geo.gamma_t - geo.gamma_i)
        start += float(np.pi + 2 * geo.gamma_t) if lobe == "TRTs" else 0.0
    phi = start + (np.arange(256) + 0.5) / 256 * 2 * np.pi
    s = (np.arange(320) + 0.5) / 320 * 2 - 1
    c = np.sqrt(1 - s * s)
    grid_s, grid_phi = np.meshgrid(s, phi, indexing="ij")
    grid_c = np.broadcast_to(c[:, None], grid_s.shape)
    wi = np.stack([grid_s, grid_c * np.cos(grid_phi), grid_c * np.sin(grid_phi)], -1)
    return wi.reshape(-1, 3), np.full(wi.size // 3, 2 / 320 * 2 * np.pi / 256)


@pytest.mark.parametrize("h", [-0.45, 0.0, 0.8])
@pytest.mark.parametrize("theta_i", [-0.9, 0.0, 0.5])
@pytest.mark.parametrize("lobe", [*bcsdf.LOBES, bcsdf.RESIDUAL])
def test_sphere_integrals(lobe: str, theta_i: float, h: float) -> None:
    """Over all directions the value gives the attenuation and every density gives 1."""
    profiles = random_profiles(np.random.default_rng(8))
    wo = [np.sin(theta_i), np.cos(theta_i), 0.0]
    wi, weight = _sphere(MODERATE, theta_i, h, lobe)
    a = bcsdf.attenuation(MODERATE, h, theta_i, profiles, residual=True)[lobe]
    value = bcsdf.evaluate(MODERATE, wo, wi, h, profiles, lobe=lobe)
    assert np.all(value >= 0)
    assert weight @ value == pytest.approx(a, rel=1e-4)
    for sampling in ("full-cdf", "attenuation-cdf"):
        density = bcsdf.direction_pdf(MODERATE, wo, wi, h, profiles, lobe=lobe, sampling=sampling)
        assert weight @ density == pytest.approx(1.0, rel=1e-4)


def test_sum_of_lobes() -> None:
    """The value is the sum of its lobes, and of the unscattered ones where that is asked for."""
    rng = np.random.default_rng(2)
    profiles = random_profiles(rng)
    wo, wi = rng.normal(size=(2, 40, 3))
    wo, wi = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wo, wi))
    h = rng.uniform(-1, 1, 40)
    lobes = [bcsdf.evaluate(MODERATE, wo, wi, h, profiles, lobe=p) for p in range(6)]
    assert np.allclose(bcsdf.evaluate(MODERATE, wo, wi, h, profiles), sum(lobes[:5]))
    assert np.allclose(bcsdf.evaluate(MODERATE, wo, wi, h, profiles, residual=True), sum(lobes))
    unscattered = bcsdf.evaluate(MODERATE, wo, wi, h, bcsdf.UNSCATTERED)
    assert np.allclose(unscattered, sum(lobes[:3]))
    for lobe in ("R", "TT", "TRT"):  # needs no profiles
        alone = bcsdf.evaluate(MODERATE, wo, wi, h, lobe=lobe)
        assert np.array_equal(alone, lobes[bcsdf.LOBES.index(lobe)])


def test_poles_and_tiny_roughness_are_finite() -> None:
    """Directions along the tangent, the smallest and the largest roughness: finite and >= 0."""
    directions = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -0.6, 0.8]], float)
    wo, wi = np.repeat(directions, 4, 0), np.tile(directions, (4, 1))
    profiles = random_profiles(np.random.default_rng(4))
    for degrees in (0.06, 143.0):
        for h in (-1.0, 0.0, 1.0):
            fibre = MODERATE.replace(beta_m_deg=degrees, beta_n_deg=degrees)
            value = bcsdf.evaluate(fibre, wo, wi, h, profiles, residual=True)
            assert np.all(np.isfinite(value))
            assert np.all(value >= 0)


def test_absorbed_azimuths_are_darker() -> None:
    """A bin that absorbs more gives less light, but is as likely to be sampled."""
    profiles = random_profiles(np.random.default_rng(5))
    profiles.azimuth.density[:] = 1 / (2 * np.pi)
    profiles.azimuth.absorption[:] = 1.0
    profiles.azimuth.absorption[..., :64, :] = 0.25
    profiles.escape[:] = 0.625
    wo = np.array([0.0, 1.0, 0.0])
    phi = np.array([-0.5, 0.5])
    wi = np.stack([0 * phi, np.cos(phi), np.sin(phi)], 1)
    value = bcsdf.evaluate(MODERATE.replace(alpha_deg=0), wo, wi, 0.0, profiles, lobe="TTs")
    density = bcsdf.direction_pdf(
        MODERATE.replace(alpha_deg=0), wo, wi, 0.0, profiles, lobe="TTs", sampling="full-cdf"
    )
    assert value[0] == pytest.approx(0.25 * value[1])
    assert density[0] == pytest.approx(density[1])


def test_scattered_light_follows_the_tilted_angle() -> None:
    """The longitudinal rows are those of theta_i - a, mirrored below zero."""
    profiles = random_profiles(np.random.default_rng(6))
    fibre = MODERATE.replace(alpha_deg=6)
    row = np.pi / 2 / 15
    for node, sign in ((3, 1), (7, -1)):
        theta_i = sign * node * row + fibre.tilt
        wo = [np.sin(theta_i), np.cos(theta_i), 0.0]
        s = (np.arange(64) + 0.5) / 32 - 1
        wi = np.stack([s, np.sqrt(1 - s * s), 0 * s], 1)
        found = bcsdf.direction_pdf(fibre, wo, wi, 0.2, profiles, lobe="TTs", sampling="full-cdf")
        back = profiles.longitudinal.density[node, 0, ::sign]
        assert found / found.sum() == pytest.approx(back / back.sum(), rel=1e-9)


@pytest.mark.parametrize(("lobe", "along", "around"), [(0, 2**0.5, 1), (1, 0.5, 2), (2, 1.5, 3)])
def test_widths(lobe: int, along: float, around: float) -> None:
    """Standard deviations from the value itself: R sqrt2 beta_m at phi = 0, TT 1/2, TRT 3/2;
    azimuthal beta_n times sqrt(1, 2, 3)."""
    fibre = Fibre(kappa=0, alpha_deg=0, beta_m_deg=1, beta_n_deg=1)
    wo, h = [0.0, 1.0, 0.0], 0.0
    x = np.linspace(-0.15, 0.15, 2001)
    phi = np.pi * (lobe % 2)
    in_theta = np.stack([np.sin(x), np.cos(x) * np.cos(phi), 0 * x], 1)
    in_phi = np.stack([0 * x, np.cos(phi + x), np.sin(phi + x)], 1)
    for wi, width in ((in_theta, along * fibre.beta_m), (in_phi, around**0.5 * fibre.beta_n)):
        value = bcsdf.evaluate(fibre, wo, wi, h, lobe=lobe)[:, 0]
        if wi is in_phi and lobe == 0:
            value = value * np.cos(0.5 * x)
        deviation = np.sqrt((value @ x**2) / value.sum())
        assert deviation == pytest.approx(width, rel=3e-3)


def test_azimuthal_nodes() -> None:
    """Tables that are linear in cos(theta_t) or in asin(h'/kappa) come back as they are."""
    fibre = MODERATE.replace(sigma_ma=0.0)
    h = np.linspace(-0.9, 0.9, 13)
    profiles, flat = flat_profiles(), flat_profiles()
    for theta in (0.0, 0.7, 1.5):
        geo = bcsdf.geometry(fibre, h, theta)
        whole = bcsdf.attenuation(fibre, h, theta, flat)["TTs"]
        inside = whole[:, 0] > 0
        cosines = np.linspace(1, np.sqrt(1 - 1 / fibre.eta**2), 4)
        profiles.escape[:] = cosines[:, None, None]
        part = bcsdf.attenuation(fibre, h, theta, profiles)["TTs"]
        assert part[inside] == pytest.approx(whole[inside] * geo.cos_theta_t[0], rel=1e-12)
        profiles.escape[:] = (np.arange(32) / 31 * np.pi / 2)[None, :, None]
        part = bcsdf.attenuation(fibre, h, theta, profiles)["TTs"]
        angle = np.arcsin(np.abs(geo.h_t[inside]) / fibre.kappa)
        assert part[inside, 0] == pytest.approx(whole[inside, 0] * angle, rel=1e-12)
