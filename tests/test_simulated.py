"""Simulated scattering: kernels against the float64 reference, samples against densities."""

from __future__ import annotations

import numpy as np
import pytest
from direction_statistics import sidak
from fibres import FIBRES
from kernel_mutants import substitute
from light_samples import compare
from model_checks import (
    SAMPLERS,
    check_mean_weight,
    check_samples_follow_their_density,
    check_sweep,
    check_weights_are_value_over_density,
    directions,
    furnace_z,
)
from offset_cells import resolved
from scene_documents import fur_patch
from simulated_tables import smooth_tables

from furcl import bcsdf
from furcl.bench.features import preprocessed
from furcl.bench.stability_compare import Comparison
from furcl.bench.stability_double_cylinder import SIMULATED_SUBJECT
from furcl.device.features import Features
from furcl.device.source import kernel_text
from furcl.errors import FibreError, SceneError
from furcl.fibre.double_cylinder import layout
from furcl.fibre.double_cylinder.model import MODEL
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.yan2015.parameters import Yan2015Fibre
from furcl.oracle.bcsdf_values import bcsdf_values
from furcl.rendering.probe import Probe
from furcl.scene.read import with_overrides

# Three channels, one, none; a thin medulla, of which much light stays inside for long.
MATERIALS = {
    name: FIBRES[name].replace(scattering="simulated") for name in ("coloured", "red-fox", "clear")
}
MATERIALS["white"] = Fibre(
    eta=1.5, kappa=0.3, sigma_ms=0.8, g=0.2, alpha_deg=-7, beta_m_deg=12, beta_n_deg=20,
    layers=1.4, scattering="simulated",
)  # fmt: skip
each_material = pytest.mark.parametrize("fibre", MATERIALS.values(), ids=MATERIALS)
SCATTERED = ("TTs", "TRTs", "residual")


def probe_of(fibre: Fibre, sampling: str, device, **options) -> Probe:
    """With smooth tables, whose cells midpoints integrate."""
    tables = smooth_tables(fibre) if fibre.has_medulla else None
    return Probe(fibre, sampling, device, profiles=tables, **options)


def worst_value(probe: Probe, seed: int = 1) -> float:
    """Largest difference of a lobe's value from the reference, over the lobe's largest value."""
    rng = np.random.default_rng(seed)
    wo, wi, h = directions(rng, 3000), directions(rng, 3000), rng.uniform(-1, 1, 3000)
    found = probe.evaluate_lobes(wo, wi, h)[0]
    off = []
    for p, name in enumerate(probe.lobes):
        want = bcsdf.evaluate(probe.fibre, wo, wi, h, probe.material.profiles, lobe=name)
        off.append(np.abs(found[p] - want).max() / max(want.max(), 1e-12))
    return max(off)


MUTANTS = {
    "no tilt": (r"in->sin_theta \* f->cos_tilt - in->cos_theta \* f->sin_tilt", "in->sin_theta"),
    "no mirror image": (r"r->mirrored \? -s : s\);\n    ScatteredTerms", "s);\n    ScatteredTerms"),
    "turned by one reflection": (r"2\.0f \* reflection\)", "reflection)"),
    "never scattered light goes with the rest": (
        r"LobeTerms terms = \{later\.unscattered \* never",
        "LobeTerms terms = {0.5f * later.unscattered * never",
    ),
}


@each_material
def test_values(device, fibre):
    assert worst_value(probe_of(fibre, "full-cdf", device)) < 1e-3


@pytest.mark.parametrize("mutant", MUTANTS)
def test_wrong_kernels_are_seen(device, monkeypatch, mutant):
    substitute(monkeypatch, *MUTANTS[mutant], within="tools/probe.cl")
    assert worst_value(probe_of(MATERIALS["coloured"], "full-cdf", device)) > 0.02


LEVEL = sidak(2 * len(SAMPLERS))


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["coloured", "white"])
@pytest.mark.parametrize("sampling", SAMPLERS)
def test_samples(device, rng, seed, name, sampling):
    """Lobe, offset and direction have their density; weights are value over density, and have the
    albedo as their mean."""
    fibre = MATERIALS[name]
    probe = probe_of(fibre, sampling, device)
    check_weights_are_value_over_density(probe, directions(rng, 8000), seed, SCATTERED)
    check_mean_weight(probe, 0.4, bcsdf.albedo(fibre, 0.4, probe.material.profiles))
    check_samples_follow_their_density(probe, 0.5, seed, LEVEL, without_edge(fibre))


def without_edge(fibre: Fibre):
    """Cells that midpoints can integrate: not those of |h| in which rays begin to miss the
    medulla."""
    edge = min(int(5.0 * fibre.kappa * fibre.eta * 1.05), 4)

    def of_lobe(lobe: int) -> np.ndarray:
        inside = resolved(lobe)
        return inside & ((np.arange(len(inside)) // 36 != edge) | (lobe == 0))

    return of_lobe


@pytest.mark.statistical
@pytest.mark.parametrize("sampling", ["full-cdf", "uniform-h"])
def test_float64_samples(sampling, seed):
    """The mean weight of the reference's own samples is the albedo, 2 % more is not; and weights
    are value over density."""
    fibre, n = MATERIALS["coloured"], 100_000
    tables, wo = smooth_tables(fibre), [np.sin(0.6), np.cos(0.6), 0.0]
    drawn = bcsdf.sample(fibre, wo, n, tables, sampling=sampling, rng=seed)
    albedo = bcsdf.albedo(fibre, 0.6, tables)
    error = 4 * drawn.weight.std(0) / np.sqrt(n)
    assert np.all(np.abs(drawn.weight.mean(0) - albedo) < error)
    assert np.all(np.abs(drawn.weight.mean(0) - 1.02 * albedo) > error)
    some = np.flatnonzero(drawn.lobe == bcsdf.LOBES.index("TTs"))[:50]
    some = np.append(some, np.flatnonzero(drawn.lobe == 5)[:50])
    for i in some:
        at = (fibre, wo, drawn.wi[i], drawn.h[i], tables)
        name = (*bcsdf.LOBES, bcsdf.RESIDUAL)[drawn.lobe[i]]
        density = bcsdf.pdf(*at, sampling=sampling, lobe=name)
        assert density == pytest.approx(drawn.pdf[i], rel=1e-6)
        value = bcsdf.evaluate(*at, lobe=name)
        assert 0.5 * value / density == pytest.approx(drawn.weight[i], rel=1e-6)


def far_field(fibre, wo, wi, tables, residual=False):
    """Means over 8000 offsets."""
    h = np.cos((np.arange(8000) + 0.5) * np.pi / 8000)
    weight = np.sqrt(1.0 - h * h) * np.pi / 16000
    values = [bcsdf.evaluate(fibre, wo, w, h, tables) for w in wi]
    return np.einsum("n,knc->kc", weight, values)


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["coloured", "white"])
@pytest.mark.parametrize("sampling", ["full-cdf", "uniform-h"])
def test_light_samples_have_the_far_field_as_their_mean(device, seed, name, sampling):
    """Within 5 standard errors. Values are below 1000 times their density: 643 was measured, of a
    thin white medulla, whose TRRT is narrow in phi while h is drawn evenly."""
    probe = probe_of(MATERIALS[name], sampling, device, light_sampling=True)
    found = compare(probe, seed, far_field, least=1e-5)
    assert found.z < 5.0
    assert found.weight < 1000.0


@pytest.mark.slow
def test_sweep(device, rng):
    """Fibres at the ends of the ranges, one in nine of the grid, and random ones. The density of
    the residual is off by 1.1e-5, measured, where so little light is left that float32 has none of
    the part that was scattered: no sample is drawn there."""
    comparison = Comparison(device, SIMULATED_SUBJECT)
    fibres = [fibre for _, _, fibre in SIMULATED_SUBJECT.grid()][::9]
    fibres += [SIMULATED_SUBJECT.random(rng) for _ in range(8)]
    for i, fibre in enumerate(fibres):
        comparison.add(fibre, SIMULATED_SUBJECT.points(fibre, rng, 100), i, False)
    rows = dict(comparison.rows)
    of_residual = rows.pop(("pdf", "residual"))
    assert (of_residual.nan, of_residual.inf, of_residual.negative) == (0, 0, 0)
    assert of_residual.max_absolute < 3e-5
    check_sweep(rows)


# Energy -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [0.0, 0.8, 1.5])
@each_material
def test_all_lobes_of_a_white_fibre_add_up_to_one(device, fibre, theta):
    """Without asking for the residual lobe; in float64, and within 1e-5 on a device."""
    white = fibre.replace(sigma_ca=0.0, sigma_ma=0.0)
    h = np.linspace(-1.0, 1.0, 201)
    tables = smooth_tables(white) if white.has_medulla else None
    lobes = bcsdf.attenuation(white, h, theta, tables)
    np.testing.assert_allclose(sum(lobes.values()), 1.0, atol=2e-14)
    found = probe_of(white, "full-cdf", device).attenuation(h, theta)
    np.testing.assert_allclose(found.sum(0), 1.0, atol=1e-5)
    model = bcsdf.attenuation(white.replace(scattering="model"), h, theta, bcsdf.UNSCATTERED)
    assert np.sum([*model.values()], axis=0).min() < 0.999  # which leaves later orders out


@pytest.mark.statistical
def test_white_fur_vanishes_in_a_furnace(device, seed):
    """Within 4 standard errors of 1; mutant: a fibre that keeps some light."""
    white = {"kappa": 0.7, "sigma_ms": 1.0, "sigma_ca": 0.0, "scattering": "simulated"}
    scene = with_overrides(
        fur_patch(white, spp=64, roulette_depth=1000),
        ["environment={kind='constant', radiance=1.0}"],
        seed=seed,
    )
    assert abs(furnace_z(scene, device)) < 4.0
    assert furnace_z(with_overrides(scene, ["fibre.sigma_ca=0.03"]), device) < -4.0


# One key ----------------------------------------------------------------------------------------


def test_fibres_of_the_model_have_none_of_it():
    """Neither code nor data; and none of the profiles where it is simulated."""
    for scattering, other in (("model", "simulated_thetas"), ("simulated", "profile_azimuth")):
        fibre = Fibre.preset("red-fox", scattering=scattering)
        features = Features(fibre=MODEL.features(fibre), sampler=None)
        assert other not in preprocessed(kernel_text("prepare/tables.cl", features))
    assert MODEL.features(Fibre.preset("red-fox")).data_words == layout.profile_words(1)
    model, simulated = (
        MODEL.features(Fibre.preset("red-fox", scattering=s)) for s in ("model", "simulated")
    )
    assert (model.n_lobes, simulated.n_lobes) == (5, 6)
    assert 4 * MODEL.features(MATERIALS["coloured"]).data_words < 2 * 2**20


def test_scenes_tell_it():
    assert fur_patch({"preset": "raccoon", "scattering": "simulated"}).build_fibre() == (
        Fibre.preset("raccoon", scattering="simulated")
    )
    assert fur_patch({"preset": "raccoon"}).build_fibre().scattering == "model"


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"scattering": "true"}, "scattering = 'true': allowed are model, simulated"),
        (
            {"scattering": "simulated", "absorption": {"variation": 0.3}},
            "scattering = 'simulated': its tables are for one absorption",
        ),
        (
            {"scattering": "simulated", "model": "yan2015"},
            "fibre.model = 'yan2015' has a medulla that refracts",
        ),
    ],
)
def test_refusals_in_scenes(table, message):
    with pytest.raises((SceneError, FibreError), match=message):
        fur_patch({"preset": "raccoon", **table}).build_fibre()


def test_refusals(device):
    with pytest.raises(FibreError, match="allowed are 'model' and 'simulated'"):
        Fibre(scattering="brute force")  # pyright: ignore[reportArgumentType]
    with pytest.raises(FibreError, match="refracts"):
        Yan2015Fibre(scattering="simulated")
    with pytest.raises(FibreError, match="tables are for one absorption"):
        Probe(MATERIALS["white"], device=device, absorbs=(0.1, 0.5))
    fibre = MATERIALS["red-fox"]
    with pytest.raises(FibreError, match="no profiles, but the medulla scatters"):
        bcsdf.evaluate(fibre, [0, 1, 0], [0, 0, 1], 0.1)
    tables = smooth_tables(fibre)
    with pytest.raises(FibreError, match="scattering = 'model'"):
        bcsdf.evaluate(fibre.replace(scattering="model"), [0, 1, 0], [0, 0, 1], 0.1, tables)


def test_bcsdf_values_have_all_lobes():
    fibre = MATERIALS["coloured"]
    wo, wi = np.array([0.0, 1.0, 0.0]), np.array([0.3, -np.sqrt(0.91), 0.0])
    found = bcsdf_values(fibre, wo, wi, 0.3, smooth_tables(fibre))
    assert list(found["lobes"]) == [*bcsdf.LOBES, "residual"]
    value = np.sum([lobe["value"] for lobe in found["lobes"].values()], axis=0)
    assert found["value"] == pytest.approx(value)
