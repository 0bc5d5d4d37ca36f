"""The fibre of Yan et al. 2015: a medulla with an index of its own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from direction_statistics import sidak
from fibre_oracles import direction, flat_profiles, smooth_profiles
from fibres import YAN2015 as FIBRES
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
from offset_cells import CELLS, N_CELLS, resolved
from scene_documents import fur_patch

from furcl.bench.stability_compare import Comparison
from furcl.bench.stability_yan2015 import YAN2015_SUBJECT
from furcl.errors import SceneError
from furcl.fibre.double_cylinder import reference as double_cylinder
from furcl.fibre.yan2015 import reference
from furcl.fibre.yan2015.parameters import Yan2015Fibre
from furcl.rendering.probe import Probe
from furcl.scene.read import with_overrides

each_fibre = pytest.mark.parametrize("fibre", FIBRES.values(), ids=FIBRES)

# Values -----------------------------------------------------------------------------------------

# Of theta_i 0.4, theta_o -0.35 and h 0.3 without medulla absorption, from formulas evaluated apart
# from this code: attenuations, values at azimuths, means over h there.
CHECKED = Yan2015Fibre(
    eta=1.55, eta_m=1.4, kappa=0.7, alpha_deg=3, beta_m_deg=8, beta_n_deg=10,
    sigma_ca=(0.3, 0.3, 0.3), sigma_ms=1.5, layers=0.6,
)  # fmt: skip
WO = direction(0.4, 0.0)
ATTENUATIONS = {
    "R": 0.0567744, "TT": 0.0, "TRT": 0.0, "TrT": 0.00195259, "TtT": 0.0904613,
    "TrRrT": 2.433e-07, "TrRtT": 2.25437e-05, "TtRtT": 0.000522213, "TtTs": 0.682869,
    "TrRtTs": 8.50881e-05, "TtRtTs": 0.00394204, "residual": 0.000284231,
}  # fmt: skip
NEAR = {"R": (-0.5, 0.180322), "TtT": (2.8, 0.709103), "TtRtT": (0.2, 0.00119157),
        "TrT": (-0.5, 0.0104853)}  # fmt: skip
FAR = {"TtT": (2.8, 0.418952), "TrT": (-0.5, 0.00226875), "TtRtT": (0.2, 0.000970570)}


def printed(value: float):
    """Within half a unit of the last printed digit, or of the fourth of the shortest."""
    return pytest.approx(value, rel=2e-4 if value == 2.433e-07 else 6e-6, abs=1e-15)


def test_reference_has_the_values_of_the_formulas():
    found = reference.attenuation(CHECKED, 0.3, 0.4, flat_profiles(), residual=True)
    assert {name: a[0] for name, a in found.items()} == {
        name: printed(a) for name, a in ATTENUATIONS.items()
    }
    for name, (phi, value) in NEAR.items():
        wi = direction(-0.35, phi)
        assert reference.evaluate(CHECKED, WO, wi, 0.3, flat_profiles(), lobe=name)[0] == printed(
            value
        )
    # The medulla's edges are at h 1.03 and 0.93 of the rim: pieces end there.
    edges = [e for e in reference.REFERENCE._shape_of(CHECKED, False, None).edges(0.4) if e < 1.0]
    cuts = np.array([0.0, *sorted(edges), 1.0])
    x, w = np.polynomial.legendre.leggauss(1000)
    angle = np.pi / 4 * (x + 1.0)
    h = (cuts[:-1, None] + np.diff(cuts)[:, None] * np.sin(angle) ** 2).ravel()
    weight = (np.diff(cuts)[:, None] * np.sin(2 * angle) * w * np.pi / 4).ravel()
    for name, (phi, value) in FAR.items():
        wi = direction(-0.35, phi)
        both = [
            reference.evaluate(CHECKED, WO, wi, s * h, flat_profiles(), lobe=name)[:, 0]
            for s in (1, -1)
        ]
        assert 0.5 * weight @ (both[0] + both[1]) == printed(value)


def test_total_reflection_and_rays_that_miss():
    fibre = dataclasses.replace(CHECKED, kappa=0.5)
    found = reference.attenuation(fibre, [0.75, 0.85], 0.4, flat_profiles(), residual=True)
    assert found["TrT"][:, 0].tolist() == [printed(0.548222), 0.0]
    assert found["TrRrT"][:, 0].tolist() == [printed(0.0293449), 0.0]
    assert found["TtTs"][0, 0] == 0.0
    assert found["residual"][0, 0] == pytest.approx(0.00165959, rel=3e-6)
    assert found["TT"][:, 0].tolist() == [0.0, printed(0.458260)]
    assert found["TRT"][:, 0].tolist() == [0.0, printed(0.0319153)]


SAME = {"R": ("R",), "TT": ("TT", "TtT"), "TRT": ("TRT", "TtRtT"), "TTs": ("TtTs",),
        "TRTs": ("TtRtTs",)}  # fmt: skip


def test_equal_indices_are_the_double_cylinder():
    """Every value, of any profiles; nothing is reflected at the medulla."""
    profiles = smooth_profiles()
    fibre = dataclasses.replace(FIBRES["dense"], eta_m=1.4, alpha_deg=4.0, sigma_ma=(0.0, 0.3, 1.0))
    rng = np.random.default_rng(5)
    wo, wi, h = directions(rng, 400), directions(rng, 400), rng.uniform(-1, 1, 400)
    for name, lobes in SAME.items():
        mine = sum(reference.evaluate(fibre, wo, wi, h, profiles, lobe=lobe) for lobe in lobes)
        other = double_cylinder.evaluate(fibre.cortex, wo, wi, h, profiles, lobe=name)
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=1e-13)
    for name in ("TrT", "TrRrT", "TrRtT", "TrRtTs"):
        assert not reference.evaluate(fibre, wo, wi, h, profiles, lobe=name).any()
    # Mutant: a medulla whose index differs in the third digit is another fibre.
    other = double_cylinder.attenuation(fibre.cortex, h, 0.3, profiles)
    near = reference.attenuation(dataclasses.replace(fibre, eta_m=1.405), h, 0.3, profiles)
    assert np.abs(near["TT"] + near["TtT"] - other["TT"]).max() > 1e-4


def trace(h: float, fibre: Yan2015Fibre, path: str) -> float:
    """Azimuth at which a ray in the normal plane leaves, by Snell's law in vectors; `path` as
    lobes are named."""
    p = np.array([np.sqrt(1 - h * h), -h])
    d = np.array([-1.0, 0.0])

    def refracted(normal, ratio):
        cos = -d @ normal
        return ratio * d + (ratio * cos - np.sqrt(1 - ratio**2 * (1 - cos**2))) * normal

    inside = False
    for event in path:
        normal = p / np.linalg.norm(p)
        against = -np.sign(d @ normal) * normal
        if event in "TR":
            if event == "R":
                d = d - 2 * (d @ normal) * normal
            elif d @ normal < 0:
                d = refracted(against, 1 / fibre.eta)
            else:
                d = refracted(against, fibre.eta)
                return float(np.arctan2(d[1], d[0]))
        elif event == "r":
            d = d - 2 * (d @ normal) * normal
        else:
            ratio = fibre.eta / fibre.eta_m
            d = refracted(against, 1 / ratio if inside else ratio)
            inside = not inside
        # To the next surface along the way.
        b, now = p @ d, p @ p
        to_medulla = b * b - (now - fibre.kappa**2)
        if inside:
            step = -b + np.sqrt(to_medulla)
        elif to_medulla > 0 and b < -1e-9:
            step = -b - np.sqrt(to_medulla)
        else:
            step = -b + np.sqrt(b * b - (now - 1))
        p = p + step * d
    raise AssertionError("the ray is still inside")


# What a ray meets, the passages through the medulla being two events each.
EVENTS = {"TrT": "TrT", "TtT": "TttT", "TrRrT": "TrRrT", "TrRtT": "TrRttT", "TtRtT": "TttRttT"}


@pytest.mark.parametrize("h", [-0.5, 0.2, 0.55])
def test_light_leaves_where_a_ray_does(h):
    for fibre in (dataclasses.replace(CHECKED, eta_m=1.3), dataclasses.replace(CHECKED, eta_m=1.7)):
        shape = reference.REFERENCE._shape_of(fibre, False, None)
        for name, events in EVENTS.items():
            phi = float(shape.specular(name, np.array(h), np.array(0.0)))
            assert np.cos(phi - trace(h, fibre, events)) == pytest.approx(1.0, abs=1e-14), name


@pytest.mark.parametrize("eta_m", [1.05, 1.35, 1.55, 1.8])
@pytest.mark.parametrize("theta", [0.0, 0.8, 1.5])
def test_all_lobes_of_a_white_fibre_add_up_to_one(eta_m, theta):
    white = dataclasses.replace(CHECKED, sigma_ca=0.0, eta_m=eta_m, kappa=0.8)
    h = np.linspace(-1.0, 1.0, 201)
    lobes = reference.attenuation(white, h, theta, flat_profiles(), residual=True)
    np.testing.assert_allclose(sum(lobes.values()), 1.0, atol=2e-14)
    eleven = np.sum([a for name, a in lobes.items() if name != "residual"], axis=0)
    assert eleven.max() <= 1.0


def test_scenes_tell_fibres():
    table = {"model": "yan2015", "preset": "raccoon", "eta_m": 1.1}
    fibre = fur_patch(table).build_fibre()
    assert isinstance(fibre, Yan2015Fibre)
    assert (fibre.eta, fibre.eta_m, fibre.kappa) == (1.452, 1.1, 0.64)
    with pytest.raises(SceneError, match=r"fibre\.eta_m = 0\.9 - allowed is a number from 1\.0001"):
        fur_patch({**table, "eta_m": 0.9}).build_fibre()


# Device -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_sweep(device, rng):
    """Indices at the ends of their range and about each other, one in seven of the other edges, and
    random fibres, at the ends of inclination and offset."""
    comparison = Comparison(device, YAN2015_SUBJECT)
    grid = list(YAN2015_SUBJECT.grid())
    fibres = [fibre for name, _, fibre in grid if name == "eta_m"]
    fibres += [fibre for name, _, fibre in grid if name != "eta_m"][::7]
    fibres += [YAN2015_SUBJECT.random(rng) for _ in range(6)]
    for i, fibre in enumerate(fibres):
        comparison.add(fibre, YAN2015_SUBJECT.points(fibre, rng, 80), i, False)
    check_sweep(comparison.rows)


LEVEL = sidak(len(FIBRES) * len(SAMPLERS))


def without_edges(lobe: int) -> np.ndarray:
    """Cells that midpoints can integrate: not those of R towards phi = pi, nor those of |h| in
    which both fibres have their edge, at 0.64 and 0.68."""
    offset = np.arange(N_CELLS) // (CELLS[1] * CELLS[2])
    return resolved(lobe) & ((offset != 3) | (lobe == 0))


@pytest.mark.statistical
@each_fibre
@pytest.mark.parametrize("sampling", SAMPLERS)
def test_samples(device, rng, seed, fibre, sampling):
    """Lobe, offset and direction have their density; weights are value over density, and have the
    albedo as their mean."""
    probe = Probe(fibre, sampling, device)
    profiles = probe.material.profiles
    check_weights_are_value_over_density(
        probe, directions(rng, 8000), seed, ("TtTs", "TrRtTs", "TtRtTs")
    )
    check_mean_weight(probe, 0.4, reference.albedo(fibre, 0.4, profiles))
    check_samples_follow_their_density(probe, 0.5, seed, LEVEL, without_edges)


@pytest.mark.statistical
def test_light_samples_have_the_far_field_as_their_mean(device, seed):
    def far_field(fibre, wo, wi, profiles, residual=False):
        h = np.cos((np.arange(4000) + 0.5) * np.pi / 4000)
        weight = np.sqrt(1.0 - h * h) * np.pi / 8000
        values = [reference.evaluate(fibre, wo, w, h, profiles, residual=residual) for w in wi]
        return np.einsum("n,knc->kc", weight, values)

    probe = Probe(FIBRES["air"], device=device, light_sampling=True, residual=True)
    assert compare(probe, seed, far_field, least=1e-5).z < 5.0


@pytest.mark.statistical
def test_white_fur_vanishes_in_a_furnace(device, seed):
    """The mean within 4 standard errors of 1; mutant: a fibre that keeps some light."""
    white = {"model": "yan2015", "eta_m": 1.2, "kappa": 0.7, "sigma_ms": 1.0, "sigma_ca": 0.0}
    scene = with_overrides(
        fur_patch(white, spp=64, roulette_depth=1000, residual=True),
        ["environment={kind='constant', radiance=1.0}"],
        seed=seed,
    )
    assert abs(furnace_z(scene, device)) < 4.0
    assert furnace_z(with_overrides(scene, ["fibre.sigma_ca=0.03"]), device) < -4.0


MUTANTS = {
    "a reflection at the medulla turns nothing": (
        r"phi \+= \(float\)medulla_reflections\(lobe\)", "phi += 0.0f",
    ),
    "TtRrT is forgotten": (r"share \*= 2\.0f;", ";"),
    "a scattered lobe is turned the other way": (r"phi - scattered_turn", "phi + scattered_turn"),
}  # fmt: skip


@pytest.mark.parametrize("mutant", MUTANTS)
def test_wrong_kernels_are_seen(device, rng, monkeypatch, mutant):
    """By single values, which else agree to 1e-4 of the largest."""

    def worst() -> float:
        fibre = dataclasses.replace(FIBRES["air"], kappa=0.7, eta_m=1.3)
        probe = Probe(fibre, device=device, profiles=None, residual=True)
        at = np.random.default_rng(1)
        wo, wi, h = directions(at, 2000), directions(at, 2000), at.uniform(-1, 1, 2000)
        found = probe.evaluate_lobes(wo, wi, h)[0]
        off = []
        for p, name in enumerate(probe.lobes):
            want = reference.evaluate(fibre, wo, wi, h, probe.material.profiles, lobe=name)
            off.append(np.abs(found[p] - want).max() / max(want.max(), 1e-12))
        return max(off)

    assert worst() < 1e-3
    substitute(monkeypatch, *MUTANTS[mutant], within="tools/probe.cl")
    assert worst() > 0.05
