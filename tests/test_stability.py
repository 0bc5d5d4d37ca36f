"""The ends of all ranges: what `furcl bench stability` sweeps, in small, and its own parts."""

import dataclasses
import json
import math
from typing import Any, cast

import numpy as np
import pytest
from kernel_harness import call
from model_checks import check_sweep

from furcl.bench import stability, stability_integrals
from furcl.bench.stability_compare import Comparison
from furcl.bench.stability_conditioning import attenuation_conditioning, reference_attenuation
from furcl.bench.stability_cylinder import CHIANG_SUBJECT
from furcl.bench.stability_double_cylinder import SUBJECT
from furcl.bench.stability_integrals import BAR, factors, integrals
from furcl.bench.stability_look import Look
from furcl.bench.stability_medulla import medulla_rows
from furcl.bench.stability_points import LAST, Points
from furcl.bench.stability_reference import reference_rows
from furcl.bench.stability_row import Row
from furcl.bench.stability_steps import WIDTHS
from furcl.errors import FibreError
from furcl.fibre.chiang.parameters import ChiangFibre
from furcl.fibre.double_cylinder.parameters import RANGES, Fibre
from furcl.rendering.probe import Probe

N_FIBRES = 40
N_POINTS = 250


@pytest.fixture(scope="module")
def swept(device):
    """Every third fibre of the grid and some random ones, on a device."""
    rng = np.random.default_rng(3)
    comparison = Comparison(device, SUBJECT)
    fibres = [fibre for _, _, fibre in SUBJECT.grid()][::4]
    for i, fibre in enumerate([*fibres, *(SUBJECT.random(rng) for _ in range(N_FIBRES))]):
        # One build for all of them: compiling takes longest.
        comparison.add(fibre, SUBJECT.points(fibre, rng, N_POINTS), i, specialised=False)
    return comparison.rows


@pytest.mark.slow
def test_sweep(swept):
    """Nothing is not finite or negative, errors are within the bars or the conditioning, energy is
    at most one, and values over densities are the weights of samples."""
    check_sweep(swept)


@pytest.mark.slow
def test_weights_are_within_the_ratios_of_a_bin(swept):
    """At most 2.8 times the energy that the tables share out (docs/model.md, Weights inside a bin),
    for every sampler; as sampled, and as float64 has it at all points. Without the peaks of the
    tables R had 697."""
    assert {"bin ratio", "sample weight", "sample weight (uniform-h)"} <= {q for q, _ in swept}
    for (quantity, lobe), row in swept.items():
        if "weight" in quantity or quantity == "bin ratio":
            assert row.excess <= 1.0, row
            if lobe in ("R", "TT", "TRT", "residual"):
                assert row.max_absolute < 5.0, row


def test_a_wrong_value_is_seen(device, monkeypatch):
    """Mutant: attenuation off by a ten-thousandth, and one NaN."""
    rng = np.random.default_rng(5)
    fibre = Fibre.preset("red-fox")
    comparison = Comparison(device, SUBJECT)
    real = SUBJECT.probe(fibre, device)

    class Wrong:
        fibre, lobes, material = real.fibre, real.lobes, real.material

        def attenuation(self, h, theta):
            values = real.attenuation(h, theta) * np.float32(1.0001)
            values[0, 7] = np.nan
            return values

    comparison._attenuation(cast(Any, Wrong()), SUBJECT.points(fibre, rng, 2000))
    assert comparison.rows["attenuation", "R"].nan == 1
    assert comparison.rows["attenuation", "TT"].excess > 1


@pytest.mark.parametrize(
    "fibre",
    [
        Fibre(kappa=0.5, sigma_ca=(1.0, 1.0, 1.0)),
        Fibre(layers=2.0, alpha_deg=0.0),
        Fibre.preset("raccoon"),
    ],
    ids=["clear medulla", "no medulla", "grey medulla"],
)
def test_specialised_kernels(device, rng, fibre):
    comparison = Comparison(device, SUBJECT)
    comparison.add(fibre, SUBJECT.points(fibre, rng, 2000), seed=1)
    for row in comparison.rows.values():
        assert (row.nan, row.inf, row.negative) == (0, 0, 0), row
        assert row.excess <= 1.0, row


def test_a_clear_medulla_shortens_the_cortex(device):
    """It neither absorbs nor scatters and is no part of the absorbing chord all the same."""
    fibre = Fibre(kappa=0.9, sigma_ca=(0.5, 1.0, 2.0))
    probe = SUBJECT.probe(fibre, device)
    h = np.linspace(-1, 1, 201).astype(np.float32).astype(np.float64)
    expected = reference_attenuation(probe, h, np.full(201, 0.4))
    np.testing.assert_allclose(probe.attenuation(h, 0.4), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(("sigma_ms", "bar"), [(1.564, 1e-6), (1000.0, 1e-5)])
def test_the_edge_of_the_medulla_is_where_the_inputs_put_it(device, rng, sigma_ms, bar):
    """Where |h'| = kappa the chord begins as a square root, and one unit in the last place of h,
    kappa or the cosine does 1e-3 to the attenuation, or 0.4. Given these exactly, errors are below
    2.5e-7 and 2.4e-6; rounding h' made them 3e-4 and 0.15."""
    fibre = Fibre(
        kappa=0.64, eta=1.452, sigma_ms=sigma_ms,
        sigma_ca=(0.05, 0.05, 0.05), sigma_ma=(0.4, 0.4, 0.4),
    )  # fmt: skip
    probe = SUBJECT.probe(fibre, device)
    h = (0.64 * 1.452 * (1 + rng.uniform(-1e-5, 1e-5, 4000))).astype(np.float32).astype(np.float64)
    at = Points(np.tile([0.0, 1.0], (4000, 1)), h, np.zeros((4000, 3)), np.zeros((4000, 3)))
    got, expected = probe.attenuation(h, 0.0), reference_attenuation(probe, h, np.zeros(4000))
    for p in (1, 3, 4):
        assert np.abs(got[p] - expected[p]).max() <= bar
    effect = attenuation_conditioning(probe, SUBJECT.neighbours, at, np.arange(4000), 1)
    assert effect.max() > 1e-3


@pytest.mark.parametrize("sampling", ["uniform-h", "attenuation-cdf", "full-cdf"])
def test_random_numbers_at_their_ends(device, sampling):
    """All combinations of 0 and 1 - 2^-24: directions of length 1, finite weights."""
    ends = np.array(np.meshgrid(*[[0.0, LAST]] * 8)).reshape(8, -1).T
    numbers = ends.reshape(-1, 2, 4)
    for theta in (0.0, 1.0, math.pi / 2):
        for fibre in (Fibre.preset("red-fox"), Fibre(beta_m_deg=0.0573, beta_n_deg=143.2)):
            probe = SUBJECT.probe(fibre, device, sampling, specialised=False)
            wo = np.array([[np.sin(theta), np.cos(theta), 0.0]])
            wi, h, lobe, weight, pdf = probe.sample(wo, n=len(numbers), numbers=numbers)
            alive = lobe < len(probe.lobes)
            assert alive.any()
            np.testing.assert_allclose(np.linalg.norm(wi[alive], axis=1), 1, atol=1e-6)
            assert np.isfinite(weight).all()
            assert (weight >= 0).all()
            assert np.isfinite(pdf).all()
            assert (np.abs(h) <= 1).all()


@pytest.mark.parametrize("sampling", ["uniform-h", "attenuation-cdf", "full-cdf"])
def test_a_lobe_of_next_to_no_energy_has_no_infinite_weight(device, sampling):
    """The random number 0 falls on the first lobe with any energy at all: here TT, of e^-100."""
    fibre = Fibre(
        kappa=0.999999, eta=2.9, layers=0.0, sigma_ms=1e-3,
        sigma_ca=(50.0, 50.0, 50.0), sigma_ma=(50.0, 50.0, 50.0),
    )  # fmt: skip
    probe = SUBJECT.probe(fibre, device, sampling, specialised=False)
    rng = np.random.default_rng(1)
    numbers = rng.random((2000, 2, 4)).astype(np.float32) * np.float32(LAST)
    numbers[:, 0, 1] = 0.0
    wo = np.array([[0.614257, 0.789106, 0.0]])
    _, _, _, weight, _ = probe.sample(wo, n=2000, numbers=numbers)
    assert np.isfinite(weight).all()


def test_an_offset_stays_in_its_bin(device):
    """A number at the end of a bin, rounded into the next one, gave weights of 10^5."""
    fibre = Fibre(
        eta=1.0001,
        kappa=0.9797,
        layers=4.3,
        sigma_ca=(1.0, 1.0, 1.0),
        sigma_ms=320.0,
        sigma_ma=(0.01, 0.01, 0.01),
    )
    probe = SUBJECT.probe(fibre, device, specialised=False)
    rng = np.random.default_rng(2)
    numbers = rng.random((20_000, 2, 4)).astype(np.float32) * np.float32(LAST)
    numbers[:, 0, 2] = np.where(rng.random(20_000) < 0.5, 0.5 * LAST, LAST)
    _, h, lobe, weight, _ = probe.sample(
        np.array([[-0.87212, 0.48929, 0.0]]), n=20_000, numbers=numbers
    )
    assert weight[lobe == 3].max() < 10
    assert np.abs(h).max() < 1


def test_lobes_at_the_rim_are_seen_by_the_tables(device):
    """At eta = 1.0001 TRT and the residual live within 1e-4 of |h| = 1 and vanish there: even steps
    in the last bin missed them, weights of 3e4, and their mean gave 286; measured 2.0."""
    probe = SUBJECT.probe(Fibre(eta=1.0001, layers=0.3), device, specialised=False)
    rng = np.random.default_rng(2)
    numbers = rng.random((50_000, 2, 4)).astype(np.float32) * np.float32(LAST)
    # the last lobe; what rounds to 1 in float32 is no number of a generator
    numbers[::2, 0, 1] = np.minimum(1.0 - 1e-4 * rng.random(25_000), LAST)
    _, _, _, weight, _ = probe.sample(np.array([[0.78, 0.6258, 0.0]]), n=50_000, numbers=numbers)
    assert weight.max() < 2.8


def test_reflectance_near_index_one(device):
    """(c - n)^2 cancels there: 1.1e-4 relative; multiplied out 2e-6."""
    fibre = Fibre(eta=1.0001, layers=1.0)
    probe = SUBJECT.probe(fibre, device, specialised=False)
    h = np.linspace(-0.99, 0.99, 500).astype(np.float32).astype(np.float64)
    expected = reference_attenuation(probe, h, np.zeros(500))[0]
    np.testing.assert_allclose(probe.attenuation(h, 0.0)[0], expected, rtol=5e-6, atol=1e-14)


@pytest.mark.parametrize("theta_deg", [0.0, 45.0, 85.0, 89.0, 89.9, 89.999])
@pytest.mark.parametrize("name", ["human-black", "red-fox", "thin cuticle", "index 1"])
def test_weights_stay_within_the_ratios_of_a_bin(device, name, theta_deg):
    """Weights over their mean: 1.1 to 2.8 in docs/model.md, Weights inside a bin. Between rows of
    the tables even in theta a thin cuticle gave 10^5 at grazing incidence."""
    thin = {"thin cuticle": Fibre(layers=1e-3), "index 1": Fibre(eta=1.0001)}
    fibre = thin.get(name) or Fibre.preset(name)
    probe = SUBJECT.probe(fibre, device, specialised=False)
    theta = math.radians(theta_deg)
    wo = np.array([math.sin(theta), math.cos(theta), 0.0])
    _, _, _, weight, _ = probe.sample(wo, n=20_000, seed=2)
    scalar = weight.mean(axis=1)
    # Measured: at most 1.08 for the presets, 1.15 at index 1, 1.41 for the thin cuticle.
    assert np.mean((scalar / scalar.mean()) ** 2) < (1.6 if name in thin else 1.3)
    assert scalar.max() < 3.0 * scalar.mean()


@pytest.mark.parametrize("lanes", [1, 16])
def test_frame_along_the_fibre(device, lanes):
    """Orthonormal however near to the tangent the ray is: the product of both is rounding there."""
    angles = np.geomspace(1e-8, 1e-2, 400)
    t = np.array([0.6, 0.48, 0.64])
    side = np.cross(t, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    wo = np.cos(angles)[:, None] * t + np.sin(angles)[:, None] * side
    make = "fibre_frame((float3)(0.6f, 0.48f, 0.64f), (float3)(x, y, z))"
    for a, b in (("tangent", "side"), ("tangent", "across"), ("across", "side")):
        dot = call(device, "geometry/frame.clh", f"dot({make}.{a}, {make}.{b})", *wo.T, lanes=lanes)
        assert np.max(np.abs(dot)) < 3e-7
    for axis in ("across", "side"):
        length = call(device, "geometry/frame.clh", f"length({make}.{axis})", *wo.T, lanes=lanes)
        np.testing.assert_allclose(length, 1.0, atol=5e-7)


def test_m_and_d_alone_integrate_to_one(device):
    """Of every lobe, for every width from the narrowest that is allowed; measured 4e-5 and 5e-7."""
    rows = factors(device, WIDTHS, (0.0, 1.0, 1.5, math.pi / 2))
    assert [(row.quantity, row.lobe) for row in rows] == [
        (f"integral of {name}", lobe) for name in "MD" for lobe in ("R", "TT", "TRT")
    ]
    for row in rows:
        assert row.points > 1000
        assert (row.nan, row.inf, row.negative) == (0, 0, 0), row
        assert row.max_relative <= BAR, row


def test_a_wrong_integral_is_seen(device, monkeypatch):
    """Mutant: densities larger by a five-hundredth."""
    real = stability_integrals.lobe_densities
    monkeypatch.setattr(
        stability_integrals,
        "lobe_densities",
        lambda *given: [np.float32(1.002) * x for x in real(*given)],
    )
    for row in factors(device, (0.1,), (0.5,)):
        assert row.excess > 1.0


def test_lobes_integrate_to_their_energy(device):
    for row in integrals(device, (1e-3, 0.41), (0.0, 1.2)):
        assert row.points > 0
        assert row.max_relative <= BAR, row


@pytest.mark.parametrize("beta", [1e-3, 0.02, 0.39, 0.41, 1.0, 1.49, 1.51, 2.5])
def test_azimuthal_density_integrates_to_one(device, beta):
    x, w = np.polynomial.legendre.leggauss(16)
    steps = beta * np.concatenate([[0], 2.0 ** np.arange(-1, 14)])
    cuts = np.unique(np.clip([-np.pi, np.pi, *steps, *-steps], -np.pi, np.pi))
    half = np.diff(cuts)[:, None] / 2
    at = ((cuts[:-1, None] + half) + half * x).ravel()
    got = call(
        device,
        "fibre/cylinder/directions.clh",
        "azimuthal_density(x, y)",
        at,
        np.float32(beta),
    )
    assert got.astype(np.float64) @ (half * w).ravel() == pytest.approx(1, abs=1e-5)


def test_profiles_of_extreme_media(device):
    (row,) = medulla_rows(device, quick=True)
    assert (row.nan, row.inf, row.negative) == (0, 0, 0)
    assert row.max_relative < 1e-4


def test_reference_against_sixty_digits():
    for row in reference_rows():
        assert row.points > 50
        assert row.max_relative < 1e-12, row


@pytest.mark.parametrize("name", RANGES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30, -1e30])
def test_parameters_outside_their_range_are_refused_by_name(name, value):
    beyond: dict[str, Any] = {name: value}
    with pytest.raises(FibreError, match=f"fibre.{name} = .*allowed"):
        Fibre(**beyond)


@pytest.mark.parametrize("name", ["beta_m_deg", "beta_n_deg"])
def test_roughness_from_a_thousandth_of_a_radian(name):
    fibre = Fibre()
    for beta in (1e-3, 2.5):
        assert getattr(fibre.replace(**{name: math.degrees(beta)}), name) == math.degrees(beta)
    for beta in (1e-4, 9.99e-4, 2.5001):
        with pytest.raises(FibreError, match=f"fibre.{name}.*0.0572958 to 143.239"):
            fibre.replace(**{name: math.degrees(beta)})


def test_rows_add_up():
    one = Row("evaluate", "R", points=3, nan=1, excess=0.5, value=2.0, worst={"h": 1})
    two = Row("evaluate", "R", points=4, inf=1, excess=0.7, value=1.0, worst={"h": 2})
    one.merge(two)
    assert (one.points, one.nan, one.inf, one.excess, one.worst) == (7, 1, 1, 0.7, {"h": 2})


@pytest.mark.slow
def test_results_report_and_replay(device, tmp_path):
    from furcl.report.stability import write_report

    results = stability.run(
        tmp_path, device=device, quick=True, n_points=2000, renders=False, seed=4
    )
    assert results["passed"]
    assert json.loads((tmp_path / "results.json").read_text())["schema"] == stability.SCHEMA
    assert "Every bar holds" in write_report(tmp_path).read_text()
    (row,) = (r for r in results["rows"] if (r["quantity"], r["lobe"]) == ("attenuation", "TT"))
    (again,) = (r for r in stability.replay(row["worst"], device) if r[:2] == ["attenuation", "TT"])
    assert again[2] == pytest.approx(row["value"], rel=1e-6)
    assert json.dumps(dataclasses.asdict(Row("a", "b")))


@pytest.mark.parametrize("number", range(9))
def test_points_that_are_looked_at(device, rng, monkeypatch, number):
    """Each sampler in each mode: nothing is wrong, and one NaN is seen."""
    fibre = ChiangFibre(sigma_a=(0.1, 0.3, 0.9))
    points = CHIANG_SUBJECT.points(fibre, rng, 500)
    look = Look(device, CHIANG_SUBJECT)
    look.add(fibre, points, number)
    assert set(look.rows) == {"R", "TT", "TRT", "residual", "sample", "light sample"}
    for row in look.rows.values():
        assert (row.points, row.nan, row.inf, row.negative) == (500, 0, 0, 0), row
    real = Probe.attenuation

    def wrong(self, h, theta):
        values = real(self, h, theta)
        values[1, 7] = np.nan
        return values

    monkeypatch.setattr(Probe, "attenuation", wrong)
    look.add(fibre, points, number)
    assert look.rows["TT"].nan == 1
    assert look.rows["TT"].worst["h"] == points.h[7]
