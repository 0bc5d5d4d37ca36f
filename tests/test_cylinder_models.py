"""The fibres of Chiang et al. 2016 and of d'Eon et al. 2011."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from cylinders import FIBRES, document, reference_of
from direction_statistics import sidak
from fibre_oracles import angles, direction, trace_cylinder
from kernel_mutants import substitute
from light_samples import compare
from model_checks import (
    SAMPLERS,
    check_mean_weight,
    check_picture_shows_albedo,
    check_reference,
    check_same_light_in_the_same_directions,
    check_samples_follow_their_density,
    check_sweep,
    check_weights_are_value_over_density,
    directions,
    furnace_z,
)
from offset_cells import resolved
from scene_documents import fur_patch, single_fibre

import furcl
from furcl.bench.stability_compare import Comparison
from furcl.bench.stability_cylinder import CHIANG_SUBJECT, DEON_SUBJECT
from furcl.errors import FibreError, SceneError
from furcl.fibre.chiang.parameters import ChiangFibre, sigma_a_from_colour
from furcl.fibre.deon.parameters import DEonFibre
from furcl.fibre.double_cylinder import reference as double_cylinder
from furcl.rendering.probe import Probe
from furcl.scene.read import with_overrides

THETAS_DEG = (0.0, -50.0, 60.0)
LEVEL = sidak(len(FIBRES) * len(SAMPLERS) * len(THETAS_DEG))
each_fibre = pytest.mark.parametrize("fibre", FIBRES.values(), ids=FIBRES)
each_sampler = pytest.mark.parametrize("sampling", SAMPLERS)
each_theta = pytest.mark.parametrize("theta_deg", THETAS_DEG)


def grey(sigma: float) -> tuple[float, float, float]:
    """The same absorption in all channels."""
    return (sigma, sigma, sigma)


# Values ---------------------------------------------------------------------------------------

# Of eta 1.55, theta_i 0.4, theta_o -0.35, h 0.3 and sigma 0.4, from formulas evaluated apart from
# this code: attenuations; at azimuths -0.5, 2.8 and 0.2 R, TT and TRT, and the residual; means over
# h at the same azimuths.
CHECKS = {
    "chiang": (
        ChiangFibre(sigma_a=grey(0.4)),
        (0.0478168, 0.402377, 0.00853896, 0.000185137),
        (0.115353, 2.08230, 0.0127109, 2.31820e-05),
        (0.0160271, 0.616637, 0.0116764, 0.000110405),
    ),
    "deon": (
        DEonFibre(sigma_a=grey(0.4)),
        (0.0478168, 0.402377, 0.00853896, 0.000185137),
        (0.136096, 4.13329, 0.0197102, 4.50650e-05),
        (0.0196702, 1.284360, 0.0192127, None),
    ),
    "deon cone": (
        DEonFibre(sigma_a=grey(0.4), cone=True),
        (0.0478168, 0.402377, 0.00853896, 0.000185137),
        (0.134387, 4.13329, 0.0197102, 4.50650e-05),
        (0.0194232, 1.284360, 0.0192127, None),
    ),
}
LOBES = ("R", "TT", "TRT", "residual")
PHIS = (-0.5, 2.8, 0.2, 0.2)
WO = direction(0.4, 0.0)


def printed(value):
    """Within half a unit of the sixth digit, to which the values are printed."""
    return pytest.approx(value, rel=6e-6)


@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_reference_has_the_values_of_the_formulas(check):
    fibre, attenuation, near, far = check
    reference = reference_of(fibre)
    found = reference.attenuation(fibre, 0.3, 0.4, residual=True)
    h, w = np.polynomial.legendre.leggauss(2000)
    for lobe, phi, a, at_h, mean in zip(LOBES, PHIS, attenuation, near, far, strict=True):
        wi = direction(-0.35, phi)
        assert found[lobe][0] == printed(a)
        assert reference.evaluate(fibre, WO, wi, 0.3, lobe=lobe, residual=True)[0] == printed(at_h)
        if mean is not None:
            values = reference.evaluate(fibre, WO, wi, h, lobe=lobe, residual=True)[:, 0]
            assert 0.5 * w @ values == printed(mean)


def test_later_orders():
    fibre = DEonFibre(sigma_a=grey(0.4), orders=5)
    found = reference_of(fibre).attenuation(fibre, 0.3, 0.4, residual=True)
    assert list(found) == ["R", "TT", "TRT", "residual", "TRRT", "TRRRT"]
    expected = (0.000181208, 3.84546e-06, 8.33751e-08)
    for name, value in zip(("TRRT", "TRRRT", "residual"), expected, strict=True):
        assert found[name][0] == printed(value)


def test_roughness_and_colour_of_chiang():
    fibre = ChiangFibre()
    assert fibre.longitudinal_width**2 == printed(0.0846112)
    assert fibre.azimuthal_scale == printed(0.117160)
    assert sigma_a_from_colour((0.2, 0.5, 0.9), 0.3) == pytest.approx(
        (0.0747053, 0.0138565, 0.000320154), rel=6e-6
    )


@pytest.mark.parametrize("h", [-0.9, 0.3, 0.7])
def test_light_leaves_where_a_ray_does(h):
    """A vector ray trace of the smooth cylinder: each lobe's azimuth and length of path."""
    beta = math.radians(0.1)
    fibre = DEonFibre(sigma_a=grey(1.0), orders=4, alpha_deg=0.0, beta_n_deg=0.1)
    reference = reference_of(fibre)
    trace = trace_cylinder(WO, h, fibre.eta, 0.0, 3)
    a = reference.attenuation(fibre, h, 0.4)
    clear = reference.attenuation(dataclasses.replace(fibre, sigma_a=grey(0.0)), h, 0.4)
    for p, name in enumerate(("R", "TT", "TRT", "TRRT")):
        theta, phi = angles(trace.leaving[p])
        assert theta == pytest.approx(-0.4, abs=1e-12)
        at, beside = (
            reference.direction_pdf(
                fibre, WO, direction(theta, phi + x), h, lobe=name, sampling="uniform-h"
            )
            for x in (0.0, 3.0 * beta)
        )
        assert beside / at == pytest.approx(math.exp(-4.5), rel=1e-6)
        inside = sum(trace.cortex[:p])
        assert a[name][0] / clear[name][0] == pytest.approx(math.exp(-inside), rel=1e-10)


def test_the_double_cylinder_without_a_medulla_is_nearly_deon():
    """R and TT agree with the cone and azimuthal widths that the double cylinder gives them."""
    mine = DEonFibre(sigma_a=grey(0.4), cone=True, beta_n_deg=10.0)
    other = furcl.Fibre(sigma_ca=grey(0.4), alpha_deg=3.0, beta_m_deg=8.0, beta_n_deg=10.0)
    wider = dataclasses.replace(mine, beta_n_deg=10.0 * math.sqrt(2.0))
    rng = np.random.default_rng(4)
    wo, wi, h = directions(rng, 200), directions(rng, 200), rng.uniform(-1, 1, 200)
    for lobe, fibre in (("R", mine), ("TT", wider)):
        np.testing.assert_allclose(
            reference_of(fibre).evaluate(fibre, wo, wi, h, lobe=lobe),
            double_cylinder.evaluate(other, wo, wi, h, lobe=lobe),
            rtol=1e-9, atol=1e-12,
        )  # fmt: skip


@each_fibre
@pytest.mark.parametrize("theta", [0.0, 0.7, 1.5])
def test_all_lobes_of_a_white_fibre_add_up_to_one(fibre, theta):
    white = dataclasses.replace(fibre, sigma_a=grey(0.0))
    h = np.linspace(-1.0, 1.0, 101)
    a = reference_of(white).attenuation(white, h, theta, residual=True)
    np.testing.assert_allclose(sum(a.values()), 1.0, atol=4e-15)


def test_references_have_what_the_page_lists():
    for fibre in FIBRES.values():
        check_reference(reference_of(fibre))


# Scenes ---------------------------------------------------------------------------------------


@each_fibre
def test_scenes_tell_fibres(fibre):
    assert fur_patch(document(fibre)).build_fibre() == fibre


def test_colours():
    scene = fur_patch({"model": "chiang", "preset": "brown", "beta_n": 0.5})
    assert scene.build_fibre().sigma_a == furcl.Fibre.preset("brown").sigma_ca
    coloured = with_overrides(
        fur_patch({"model": "chiang", "colour": [0.2, 0.5, 0.9], "beta_n": 0.3}), []
    )
    assert coloured.build_fibre().sigma_a == sigma_a_from_colour((0.2, 0.5, 0.9), 0.3)
    melanin = {"eumelanin": 1.3, "pheomelanin": 0.2}
    assert fur_patch({"model": "deon", "melanin": melanin}).build_fibre().sigma_a == (
        furcl.Fibre.preset("brown").sigma_ca
    )


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"model": "chiang"}, "there is neither a preset nor a colour"),
        ({"model": "chiang", "preset": "brwn"}, "did you mean 'brown'"),
        ({"model": "chiang", "sigma_a": 1, "colour": [1, 1, 1]}, "sigma_a and colour; keep one"),
        ({"model": "chiang", "sigma_a": 1, "beta_m": 0.0}, "fibre.beta_m = 0.0 - allowed is"),
        ({"model": "chiang", "sigma_a": 1, "kappa": 0.0}, "unknown key fibre.kappa"),
        ({"model": "deon", "sigma_a": -1.0}, "fibre.sigma_a = -1.0 - allowed is"),
        ({"model": "deon", "sigma_a": 1, "orders": 9}, "fibre.orders = 9: expected `int` <= 8"),
        ({"model": "deon", "sigma_a": 1, "cone": 1}, "fibre.cone = 1: expected `bool`"),
    ],
)
def test_bad_tables_are_refused(table, message):
    with pytest.raises((SceneError, FibreError)) as caught:
        fur_patch(table).build_fibre()
    assert message in str(caught.value)


# Device ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("specialised", [False, True])
@pytest.mark.parametrize("subject", [CHIANG_SUBJECT, DEON_SUBJECT], ids=lambda s: s.model.name)
def test_sweep(device, rng, subject, specialised):
    """The edges of its parameters and random fibres, at the ends of inclination and offset."""
    comparison = Comparison(device, subject)
    fibres = [fibre for _, _, fibre in subject.grid()]
    fibres += [subject.random(rng) for _ in range(20)]
    for i, fibre in enumerate(fibres):
        comparison.add(fibre, subject.points(fibre, rng, 250), i, specialised)
    check_sweep(comparison.rows)


@each_fibre
@each_sampler
def test_weight_is_value_over_pdf(device, rng, seed, fibre, sampling):
    probe = Probe(fibre, sampling=sampling, device=device)
    check_weights_are_value_over_density(probe, directions(rng, 20_000), seed)


@pytest.mark.statistical
@each_fibre
@each_sampler
@each_theta
def test_chi_square(device, seed, fibre, theta_deg, sampling):
    """Cells of R towards phi = pi are left out: there it turns by more than its width within a bin
    of h."""
    probe = Probe(fibre, sampling=sampling, device=device)
    check_samples_follow_their_density(probe, np.deg2rad(theta_deg), seed, LEVEL, resolved)


@pytest.mark.statistical
@each_fibre
@each_sampler
@each_theta
def test_same_light_in_the_same_directions(device, seed, fibre, theta_deg, sampling):
    probe = Probe(fibre, sampling=sampling, device=device)
    level = sidak(6 * len(FIBRES) * len(SAMPLERS) * len(THETAS_DEG))
    check_same_light_in_the_same_directions(
        probe, reference_of(fibre), np.deg2rad(theta_deg), seed, level
    )


@pytest.mark.statistical
@each_fibre
@each_sampler
def test_mean_weight_is_the_albedo(device, fibre, sampling):
    probe = Probe(fibre, sampling=sampling, device=device)
    check_mean_weight(probe, 0.4, reference_of(fibre).albedo(fibre, 0.4))


# Pictures -------------------------------------------------------------------------------------


@pytest.mark.statistical
@each_fibre
@pytest.mark.parametrize("light_sampling", ["bcsdf", "mis"])
def test_single_fibre_shows_its_albedo(device, seed, fibre, light_sampling):
    scene = single_fibre(30.0, document(fibre), light_sampling=light_sampling, seed=seed)
    theta = np.deg2rad(30.0)
    check_picture_shows_albedo(scene, device, lambda _: reference_of(fibre).albedo(fibre, theta))


@pytest.mark.statistical
@pytest.mark.parametrize("model", ["chiang", "deon"])
@pytest.mark.parametrize("light_sampling", ["bcsdf", "mis"])
def test_white_fur_vanishes_in_a_furnace(device, seed, model, light_sampling):
    """The mean within 4 standard errors of 1; mutant: a fibre that keeps some light."""
    scene = with_overrides(
        fur_patch(
            {"model": model, "preset": "white"}, spp=128, roulette_depth=1000, residual=True,
            light_sampling=light_sampling,
        ),
        ["environment={kind='constant', radiance=1.0}"],
        seed=seed,
    )  # fmt: skip
    assert abs(furnace_z(scene, device)) < 4.0
    darker = with_overrides(scene, [f"fibre={{model='{model}', sigma_a=0.02}}"])
    assert furnace_z(darker, device) < -4.0


def test_a_scene_compiles_nothing_of_other_models(device):
    stats = furcl.render(fur_patch(document(FIBRES["chiang"]), spp=1), device=device).stats
    assert set(stats["lobes"]) >= {"R", "TT", "TRT", "residual"}
    assert not {"medulla", "scattered"} & set(stats["features"]["left_out"])


# Light samples --------------------------------------------------------------------------------

LIMIT = 4.0
"""Of z, as in test_light_samples.py."""


def far_field(fibre, wo, wi, profiles, residual=False):
    """Mean of the reference over h (n, 3), h as a cosine."""
    h = np.cos((np.arange(8000) + 0.5) * np.pi / 8000)
    weight = np.sqrt(1.0 - h * h) * np.pi / 16_000
    values = [reference_of(fibre).evaluate(fibre, wo, w, h, residual=residual) for w in wi]
    return np.einsum("n,knc->kc", weight, values)


@pytest.mark.statistical
@each_fibre
def test_light_samples_have_the_far_field_as_their_mean(device, seed, fibre):
    probe = Probe(fibre, device=device, light_sampling=True, residual=True)
    assert compare(probe, seed, far_field).z < LIMIT


# Mutants --------------------------------------------------------------------------------------

LIGHT_MUTANTS = {
    "h of TT is that of another azimuth": (r"specular - PI\b", "specular - 3.0f"),
    "half of R is forgotten": (r"0\.25f \* cos_gamma", "0.125f * cos_gamma"),
    "one side of later lobes is forgotten": (
        r"(bcsdf_at_offset\(fibre, in, )2\.0f \* xi\.y - 1\.0f", r"\1 xi.y"
    ),
}  # fmt: skip
SAMPLING_MUTANTS = {
    "an azimuth a tenth too wide": (r"f->scale \* natural_log", "1.1f * f->scale * natural_log"),
    "R without its tilt": (r"sin_d = f->sin_tilt_2", "sin_d = -f->sin_tilt_2"),
    "the width of TT is that of R": (r"FURCL_LOBE_TT \? 0\.5f", "FURCL_LOBE_TT ? 1.0f"),
}


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", LIGHT_MUTANTS)
def test_wrong_light_samples_are_seen(device, seed, monkeypatch, mutant):
    substitute(monkeypatch, *LIGHT_MUTANTS[mutant], within="tools/probe.cl")
    probe = Probe(ChiangFibre(beta_n=0.2), device=device, light_sampling=True)
    assert compare(probe, seed, far_field).z > 2 * LIMIT


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", SAMPLING_MUTANTS)
def test_wrong_directions_are_seen(device, seed, monkeypatch, mutant):
    """By chi-square, or where samples and density are wrong together by float64 samples."""
    substitute(monkeypatch, *SAMPLING_MUTANTS[mutant], within="tools/probe.cl")
    fibre = ChiangFibre(alpha_deg=6.0, sigma_a=grey(0.3))
    probe = Probe(fibre, device=device)

    def check_both():
        check_samples_follow_their_density(probe, 0.3, seed, LEVEL, resolved)
        check_same_light_in_the_same_directions(probe, reference_of(fibre), 0.3, seed, LEVEL)

    with pytest.raises(AssertionError):
        check_both()
