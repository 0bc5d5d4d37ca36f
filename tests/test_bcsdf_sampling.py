"""The float64 samplers: their joint density, weights, means and chi-square, each with a mutant."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from direction_statistics import chi_square_p, sidak
from fibre_oracles import random_profiles, smooth_profiles
from fibres import FIBRES
from offset_cells import N_CELLS, cell, integrals, resolved, wo_at

from furcl import bcsdf
from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre

NAMES = (*bcsdf.LOBES, bcsdf.RESIDUAL)
CASES = [("human-black", 0.0), ("raccoon", 20.0), ("coloured", -65.0), ("all medulla", 40.0)]
N = 200_000


def _turned(theta: float, phi: float) -> np.ndarray:
    """wo at an azimuth of its own."""
    s, c = np.sin(theta), np.cos(theta)
    return np.array([s, c * np.cos(phi), c * np.sin(phi)])


@pytest.mark.parametrize("theta_deg", [-88.0, 35.0, 90.0])
@pytest.mark.parametrize("name", ["human-black", "clear", "coloured", "all medulla"])
@pytest.mark.parametrize("sampling", bcsdf.SAMPLING)
def test_joint_density_integrates_to_one(sampling: str, name: str, theta_deg: float) -> None:
    """Over lobes and h; in one bin it is constant where the sampler has bins."""
    h = (np.arange(4000) + 0.5) / 2000 - 1
    arguments = (FIBRES[name], np.deg2rad(theta_deg), h, smooth_profiles())
    q = bcsdf.joint_densities(*arguments, sampling=sampling, residual=True)
    assert tuple(q) == NAMES
    total = sum(q.values())
    assert isinstance(total, np.ndarray)
    assert total.mean() * 2 == pytest.approx(1.0, abs=1e-12)
    if sampling == "uniform-h":
        assert total == pytest.approx(np.full(h.size, 0.5))
    else:
        assert all(not np.ptp(row.reshape(200, 20), axis=1).any() for row in q.values())
        without = bcsdf.joint_densities(*arguments, sampling=sampling)["R"]
        energies = [
            bcsdf.albedo(FIBRES[name], np.deg2rad(theta_deg), smooth_profiles(), residual=r).mean()
            for r in (False, True)
        ]
        assert q["R"] * energies[1] == pytest.approx(without * energies[0], rel=1e-6)


@pytest.mark.parametrize("theta", [-0.6, 0.2])
@pytest.mark.parametrize("sampling", ["attenuation-cdf", "full-cdf"])
def test_bins_hold_the_attenuation(sampling: str, theta: float) -> None:
    """The paper's equations: P(lobe) by the integral of A_p over h, and in a bin its mean over that
    integral; 400 midpoints in each of 200 bins."""
    fibre, profiles = FIBRES["coloured"], smooth_profiles()
    h = (np.arange(80_000) + 0.5) / 40_000 - 1
    lobes = bcsdf.attenuation(fibre, h, theta, profiles)
    means = {p: lobes[p].mean(-1).reshape(200, 400).mean(-1) for p in bcsdf.LOBES}
    total = sum(mean.sum() for mean in means.values())
    q = bcsdf.joint_densities(fibre, theta, h[200::400], profiles, sampling=sampling)
    for p, mean in means.items():
        chance, inside = mean.sum() / total, mean / mean.sum() / (2 / 200)
        assert q[p] == pytest.approx(chance * inside, rel=2e-3)


def test_joint_density_broadcasts() -> None:
    """theta and h of any shapes, one table for each inclination."""
    theta, h = np.array([[0.1], [-0.7]]), np.linspace(-1, 1, 5)
    both = bcsdf.joint_densities(MODERATE, theta, h, smooth_profiles(), sampling="full-cdf")
    for row, angle in enumerate(theta[:, 0]):
        one = bcsdf.joint_densities(MODERATE, angle, h, smooth_profiles(), sampling="full-cdf")
        assert all(np.array_equal(both[p][row], one[p]) for p in bcsdf.LOBES)


@pytest.mark.parametrize("sampling", bcsdf.SAMPLING)
@pytest.mark.parametrize("name", FIBRES)
def test_weight_is_value_over_pdf(name: str, sampling: str) -> None:
    """Each sample by itself, from the wi that was returned, with wo at any azimuth."""
    fibre, profiles = FIBRES[name], random_profiles(np.random.default_rng(3))
    wo = _turned(-0.7, 2.2)
    drawn = bcsdf.sample(fibre, wo, 4000, profiles, sampling=sampling, rng=4, residual=True)
    assert np.linalg.norm(drawn.wi, axis=1) == pytest.approx(np.ones(4000))
    for p, lobe in enumerate(NAMES):
        mine = drawn.lobe == p
        wi, h = drawn.wi[mine], drawn.h[mine]
        density = bcsdf.pdf(fibre, wo, wi, h, profiles, sampling=sampling, lobe=lobe, residual=True)
        value = bcsdf.evaluate(fibre, wo, wi, h, profiles, lobe=lobe)
        # Directions found again from wi: profiles are constant in bins, and lobes of 1e-2 rad far
        # from their centre lose digits. Measured 2e-12.
        assert density == pytest.approx(drawn.pdf[mine], rel=1e-9)
        assert 0.5 * value / density[:, None] == pytest.approx(drawn.weight[mine], rel=1e-9)


def test_pdf_adds_up() -> None:
    """pdf is q(lobe, h) times the density of the direction, and without a lobe their sum."""
    rng, profiles = np.random.default_rng(6), random_profiles(np.random.default_rng(7))
    wo, wi = rng.normal(size=(2, 30, 3))
    wo, wi = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wo, wi))
    h, theta = rng.uniform(-1, 1, 30), np.arcsin(wo[:, 0])
    for sampling in bcsdf.SAMPLING:
        options = {"sampling": sampling, "residual": True}
        q = bcsdf.joint_densities(MODERATE, theta, h, profiles, **options)
        total = np.zeros(30)
        for lobe in NAMES:
            part = bcsdf.pdf(MODERATE, wo, wi, h, profiles, **options, lobe=lobe)
            direction = bcsdf.direction_pdf(
                MODERATE, wo, wi, h, profiles, lobe=lobe, sampling=sampling
            )
            assert part == pytest.approx(q[lobe] * direction, rel=1e-12)
            total += part
        assert bcsdf.pdf(MODERATE, wo, wi, h, profiles, **options) == pytest.approx(total)


def _mean_is(found: np.ndarray, expected: np.ndarray, errors: float = 4.0) -> bool:
    """Whether the mean of found (n, 3) is within some standard errors, in every channel."""
    error = found.std(axis=0) / np.sqrt(len(found))
    return bool(np.all(np.abs(found.mean(axis=0) - expected) < errors * error + 1e-12))


@pytest.mark.statistical
@pytest.mark.parametrize(("name", "theta_deg"), CASES)
@pytest.mark.parametrize("sampling", bcsdf.SAMPLING)
def test_mean_weight_is_the_albedo(sampling: str, name: str, theta_deg: float, seed: int) -> None:
    """Of all samples and of each lobe that is drawn a thousand times, within 4 standard errors
    (alpha 6e-5 a channel); 2 % more, or the residual forgotten, must be seen."""
    fibre, profiles, theta = FIBRES[name], smooth_profiles(), np.deg2rad(theta_deg)
    drawn = bcsdf.sample(
        fibre, wo_at(theta), N, profiles, sampling=sampling, rng=seed, residual=True
    )
    assert abs(np.sign(drawn.h).mean()) < 4 / np.sqrt(N)  # both sides alike
    lobes = bcsdf.lobe_albedos(fibre, theta, profiles, residual=True)
    expected = np.sum(list(lobes.values()), axis=0)
    assert _mean_is(drawn.weight, expected)
    assert not _mean_is(drawn.weight, 1.02 * expected)
    for p, lobe in enumerate(NAMES):
        mine = (drawn.lobe == p)[:, None]
        if mine.sum() > 1000:
            assert _mean_is(drawn.weight * mine, lobes[lobe]), lobe
            assert not _mean_is(drawn.weight * mine, 1.25 * lobes[lobe]), lobe


CHI_SQUARE = [(name, theta, s) for s in bcsdf.SAMPLING for name, theta in CASES[1:]]
LEVEL = sidak(6 * len(CHI_SQUARE))


@pytest.mark.statistical
@pytest.mark.parametrize(("name", "theta_deg", "sampling"), CHI_SQUARE)
def test_chi_square(name: str, theta_deg: float, sampling: str, seed: int) -> None:
    """Counts in cells of (|h|, phi, s) of every lobe against the integral of its density.

    Mutants: 5 % too many, and the mirror image (a wrong sign of h or phi), where the lobe has at
    least a fifth of the samples.
    """
    fibre, profiles, theta = FIBRES[name], smooth_profiles(), np.deg2rad(theta_deg)
    wo, options = wo_at(theta), {"sampling": sampling, "residual": True}
    drawn = bcsdf.sample(fibre, wo, N, profiles, rng=seed, **options)

    def densities(wi: np.ndarray, h: float) -> np.ndarray:
        q = bcsdf.joint_densities(fibre, theta, h, profiles, **options)
        return np.stack(
            [
                q[p] * bcsdf.direction_pdf(fibre, wo, wi, h, profiles, lobe=p, sampling=sampling)
                for p in NAMES
            ]
        )

    expected = N * integrals(densities)
    phi = np.arctan2(drawn.wi[:, 2], drawn.wi[:, 1])
    cells, mirrored = (cell(h, phi, drawn.wi[:, 0]) for h in (drawn.h, -drawn.h))
    for p, lobe in enumerate(NAMES):
        inside, mine = resolved(p), drawn.lobe == p
        predicted = expected[p][inside]
        if predicted.sum() < 10 * N_CELLS:  # says nothing but how often the lobe is chosen
            counts = np.bincount(cells[mine], minlength=N_CELLS)[inside]
            assert abs(counts.sum() - predicted.sum()) < 10 + 5 * np.sqrt(predicted.sum())
            continue
        assert _p(cells[mine], inside, predicted) > LEVEL, lobe
        if predicted.sum() > 0.2 * N:
            assert _p(cells[mine], inside, 1.05 * predicted) < LEVEL, lobe
            if lobe in ("R", "TT", "TRT") or sampling == "full-cdf":  # others have no sides
                assert _p(mirrored[mine], inside, predicted) < LEVEL, lobe


def _p(cells: np.ndarray, inside: np.ndarray, predicted: np.ndarray) -> float:
    """p-value of the counts in cells, and of all the rest of the N samples."""
    counts = np.bincount(cells, minlength=N_CELLS)[inside]
    rest = [N - counts.sum()], [N - predicted.sum()]
    return chi_square_p(np.append(counts, rest[0]), np.append(predicted, rest[1]))


NARROW = Fibre(eta=1.4, alpha_deg=4, beta_m_deg=0.06, beta_n_deg=0.06)


@pytest.mark.parametrize("theta_deg", [-60.0, 0.0, 70.0])
@pytest.mark.parametrize(("lobe", "shift"), [("TT", 1), ("TRT", 3)])
def test_narrow_lobes_are_drawn_around_their_centre(
    lobe: str, shift: int, theta_deg: float
) -> None:
    """Lobes of 1e-3 rad, which no grid of cells sees: all samples within 8 widths of the centre,
    where a tilt turned round would leave none."""
    theta, p = np.deg2rad(theta_deg), shift // 2 + 1
    drawn = bcsdf.sample(NARROW, wo_at(theta), 4000, sampling="full-cdf", rng=1)
    mine = drawn.lobe == p
    assert mine.sum() > 20
    wi, h = drawn.wi[mine], drawn.h[mine]
    off = np.arctan2(wi[:, 2], wi[:, 1]) - bcsdf.geometry(NARROW, h, theta).Phi(p)
    assert np.abs((off + np.pi) % (2 * np.pi) - np.pi).max() < 8 * NARROW.beta_n * np.sqrt(p + 1)
    inclination = np.arcsin(wi[:, 0])
    assert np.abs(inclination + theta - shift * NARROW.alpha).max() < 8 * 1.6e-3
    assert np.abs(inclination + theta + shift * NARROW.alpha).min() > 8 * 1.6e-3


@pytest.mark.parametrize("sampling", bcsdf.SAMPLING)
def test_a_fibre_that_returns_nothing(sampling: str) -> None:
    """No reflection and an opaque cortex: no lobe, no direction, no weight."""
    fibre = Fibre(layers=0.0, sigma_ca=(1e4, 1e4, 1e4))
    drawn = bcsdf.sample(fibre, [0.0, 1.0, 0.0], 50, sampling=sampling, rng=1)
    none = drawn.lobe == 5
    assert none.sum() > 40  # h uniform may meet the rim
    assert not drawn.wi[none].any()
    assert not drawn.weight[none].any()
    assert not drawn.pdf[none].any()


def test_same_seed_same_samples() -> None:
    first, second, other = (
        bcsdf.sample(MODERATE, wo_at(0.3), 50, smooth_profiles(), sampling="full-cdf", rng=rng)
        for rng in (5, np.random.default_rng(5), 6)
    )
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    assert not np.array_equal(first.wi, other.wi)


def test_many_directions_at_once() -> None:
    """(n, 3) wo, each with the bins of its own inclination: the means are those of one wo."""
    theta = np.repeat([-0.5, 0.9], 40_000)
    wo = np.stack([np.sin(theta), np.cos(theta), 0 * theta], 1)
    drawn = bcsdf.sample(MODERATE, wo, profiles=smooth_profiles(), sampling="full-cdf", rng=2)
    for angle in (-0.5, 0.9):
        expected = bcsdf.albedo(MODERATE, angle, smooth_profiles())
        assert _mean_is(drawn.weight[theta == angle], expected)


MODERATE = FIBRES["coloured"]
WO, WI = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
PROFILES = smooth_profiles()


@pytest.mark.parametrize(
    ("arguments", "keywords"),
    [
        (("TTs", PROFILES, "full-cdf"), {}),
        (("TTs", PROFILES), {"sampling": "full-cdf"}),
        (("TTs", PROFILES), {}),
        (("TTs",), {"profiles": PROFILES}),
        (("TTs",), {"sampling": "uniform-h"}),
        ((3,), {"sampling": "uniform-h"}),
        (("R",), {}),
        ((), {"lobe": "R"}),
        ((), {"lobe": "R", "sampling": "full-cdf"}),
        ((), {"lobe": "R", "profiles": PROFILES, "sampling": "full-cdf"}),
    ],
)
def test_calls_for_the_density_of_a_direction_fail(arguments: tuple, keywords: dict) -> None:
    """pdf(fibre, wo, wi, h, lobe, profiles, sampling) asks for `direction_pdf`, in every form."""
    pdf: Callable[..., Any] = bcsdf.pdf
    with pytest.raises((TypeError, FibreError)):
        pdf(MODERATE, WO, WI, 0.2, *arguments, **keywords)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: bcsdf.sample(MODERATE, WO, -1, PROFILES, sampling="full-cdf", rng=1), "n = -1"),
        (lambda: bcsdf.sample(MODERATE, WO, None, PROFILES, sampling="full-cdf", rng=1), "n = "),
        (lambda: bcsdf.sample(MODERATE, [WO, WI], 5, PROFILES, sampling="full-cdf", rng=1), "n = "),
        (lambda: bcsdf.sample(MODERATE, 2 * WO, 5, PROFILES, sampling="full-cdf", rng=1), "wo has"),
        (lambda: bcsdf.sample(MODERATE, WO, 5, PROFILES, sampling="cdf", rng=1), "sampling 'cdf'"),
        (
            lambda: bcsdf.direction_pdf(MODERATE, WO, WI, 0.1, PROFILES, lobe=0, sampling="cdf"),
            "sampling 'cdf' is not known",
        ),
        (
            lambda: bcsdf.pdf(
                MODERATE, WO, WI, 0.1, PROFILES, sampling="full-cdf", lobe="residual"
            ),
            "residual=True",
        ),
        (lambda: bcsdf.joint_densities(MODERATE, 2.0, 0.0, PROFILES, sampling="full-cdf"), "theta"),
        (lambda: bcsdf.joint_densities(MODERATE, 0.0, 2.0, PROFILES, sampling="full-cdf"), "h has"),
    ],
)  # fmt: skip
def test_refusals(call, message: str) -> None:
    with pytest.raises(FibreError, match=message):
        call()


def test_directions_without_a_medulla_have_no_scattered_density() -> None:
    clear = MODERATE.replace(kappa=0.0)
    for sampling in bcsdf.SAMPLING:
        assert bcsdf.direction_pdf(clear, WO, WI, 0.1, lobe="TTs", sampling=sampling) == 0.0
    uniform = bcsdf.direction_pdf(MODERATE, WO, WI, 0.1, lobe="TTs", sampling="uniform-h")
    assert uniform == pytest.approx(0.25 / np.pi)
