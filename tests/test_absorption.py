"""Absorption that differs between strands and along them: values, tables, pictures."""

from __future__ import annotations

import itertools

import msgspec
import numpy as np
import pytest
from direction_statistics import sidak
from kernel_mutants import substitute
from model_checks import (
    check_mean_weight,
    check_samples_follow_their_density,
    check_weights_are_value_over_density,
    directions,
)
from offset_cells import resolved, wo_at
from scene_documents import INDEPENDENT, even_patch
from scipy import stats

from furcl.cli.facts import of_groom, of_scene
from furcl.device.layout import ABSORPTION_HEADER, ABSORPTION_NODES
from furcl.errors import FibreError, GroomError, SceneError
from furcl.fibre.absorption import Absorption
from furcl.fibre.double_cylinder import reference as bcsdf
from furcl.fibre.double_cylinder.model import MODEL, DoubleCylinder
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.model import FibreModel
from furcl.fibre.packed import LEVELS, RANK_VERTICES, bind
from furcl.fibre.pigment import sigma_ca_from_colour, sigma_ca_from_melanin
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves
from furcl.groom.joined import Groom, Grooms
from furcl.rendering.probe import Probe
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene, with_overrides

RANGE = (0.05, 4.0)
FIBRE = Fibre(kappa=0.5, sigma_ms=1.5, beta_m_deg=12, beta_n_deg=15, g=0.3, layers=0.7)
SIGMAS = {
    "of a node": (4.0, 4.0, 4.0),
    "of the other end": (0.05, 0.05, 0.05),
    "grey": (0.6, 0.6, 0.6),
    "coloured": (0.2, 0.7, 1.5),
}
LEVEL = sidak(2 * 5 * len(SIGMAS))
"""Of one lobe's test."""


def probe_of(device, sigma, **options) -> Probe:
    options = {"sampling": "attenuation-cdf", "channels": 3, **options}
    return Probe(FIBRE.replace(sigma_ca=sigma), device=device, absorbs=RANGE, **options)


# Tables that are mixed between absorptions.


@pytest.mark.statistical
@pytest.mark.parametrize("name", SIGMAS)
@pytest.mark.parametrize("theta", [0.35, 1.1])
def test_samples_follow_their_density(device, seed, name, theta):
    probe = probe_of(device, SIGMAS[name])
    check_samples_follow_their_density(probe, theta, seed, LEVEL, resolved)


@pytest.mark.parametrize("sampling", ["attenuation-cdf", "full-cdf", "uniform-h"])
def test_weights_are_value_over_density(device, rng, sampling):
    probe = probe_of(device, SIGMAS["coloured"], sampling=sampling)
    check_weights_are_value_over_density(probe, directions(rng, 20_000), 5, ("TTs", "TRTs"))


@pytest.mark.parametrize("name", SIGMAS)
@pytest.mark.parametrize("theta", [0.2, 1.3])
def test_the_mean_weight_is_the_albedo(device, name, theta):
    probe = probe_of(device, SIGMAS[name])
    check_mean_weight(probe, theta, bcsdf.albedo(probe.fibre, theta, probe.material.profiles))


MUTANTS = {
    "the row of another absorption": (
        r"picked = \(TableRow\)\{mixed_node\(rows, i\), rows->theta.node \+ r\};",
        "picked = (TableRow){rows->node[0], rows->theta.node + r};",
    ),
    "the density of another absorption": (
        r"joint_of\(fibre, \(TableRow\)\{mixed_node\(rows, i\), rows->theta.node\}, lobe, bin\)",
        "joint_of(fibre, (TableRow){rows->node[0], rows->theta.node}, lobe, bin)",
    ),
    "weights that are not those of the row": (r"left -= weight;", "left -= 0.7f * weight;"),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_mixture_is_seen(device, monkeypatch, name):
    substitute(monkeypatch, *MUTANTS[name], "tools/probe.cl")
    probe = probe_of(device, SIGMAS["coloured"])
    with pytest.raises(AssertionError):
        check_samples_follow_their_density(probe, 0.35, 11, LEVEL, resolved)


@pytest.mark.parametrize("name", SIGMAS)
def test_a_mixture_is_as_good_as_tables_of_its_own(device, name):
    """Deviation of the weights, mean of the channels, over their mean: within 2 % of that with
    tables made for the absorption (measured: 0.5 %)."""
    mixed = probe_of(device, SIGMAS[name])
    own = Probe(mixed.fibre, "attenuation-cdf", device, channels=3)
    for theta in (0.2, 1.1):
        found = [
            (weight.std() / weight.mean(), weight.max())
            for weight in (
                probe.sample(wo_at(theta), n=200_000, seed=3)[3].mean(axis=1)
                for probe in (own, mixed)
            )
        ]
        (spread_own, largest_own), (spread, largest) = found
        assert spread < 1.02 * spread_own
        assert largest < 1.2 * largest_own


@pytest.mark.parametrize("name", SIGMAS)
def test_light_samples_estimate_the_mean_over_h(device, name, rng):
    probe = probe_of(device, SIGMAS[name], light_sampling=True)
    wo = wo_at(0.4)
    wi = directions(rng, 4)
    for w in wi:
        value, _ = probe.estimate_far_field(wo, np.tile(w, (40_000, 1)), seed=7)
        h = np.linspace(-1.0, 1.0, 4001)[:-1] + 1.0 / 4000
        expected = probe.evaluate(wo, w, h).astype(np.float64).mean(axis=0)
        error = 4.5 * value.std(axis=0) / np.sqrt(len(value)) + 1e-3 * expected + 1e-6
        assert np.all(np.abs(value.mean(axis=0) - expected) < error)


# Values.


@pytest.fixture
def curves(rng):
    points = rng.normal(size=(90, 7, 3)).cumsum(axis=1)
    return Curves.from_arrays(
        points,
        0.1,
        attributes={
            "tint": rng.uniform(0.1, 1.0, (90, 3)),
            "shade": rng.uniform(0.0, 1.0, (90, 7)),
            "age": rng.uniform(0.0, 60.0, 90),
        },
    )


def values(curves, **table):
    absorption = Absorption(**table)
    return absorption.roots(curves, MODEL, FIBRE, "fur").astype(np.float64) ** 2


def test_colours_of_strands(curves):
    found = values(curves, attribute="tint")
    expected = [sigma_ca_from_colour(c, FIBRE.beta_n_deg) for c in curves.attributes["tint"]]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)


def test_ramps_follow_the_length_of_the_strand(curves):
    """Sigma of 1 at the root, 3 at the middle of the length, 2 at the tip."""
    found = values(curves, ramp=((1.0,), (3.0,), (2.0,)), quantity="sigma").reshape(90, 7, 3)
    strands = curves.points.reshape(90, 7, 3).astype(float)
    for strand, got in zip(strands, found, strict=True):
        steps = [np.linalg.norm(b - a) for a, b in itertools.pairwise(strand)]
        for k in range(7):
            s = sum(steps[:k]) / sum(steps)
            expected = 1.0 + 4.0 * s if s < 0.5 else 3.0 - 2.0 * (s - 0.5)
            assert got[k] == pytest.approx([expected] * 3, rel=1e-4)


def test_melanin_by_an_attribute(curves):
    found = values(
        curves, attribute="age", at=(0, 60), ramp=((2.0, 0.5), (0.0, 0.1)), quantity="melanin"
    )
    for age, got in zip(curves.attributes["age"], found, strict=True):
        t = float(age) / 60.0
        expected = sigma_ca_from_melanin(2.0 - 2.0 * t, 0.5 - 0.4 * t)
        assert got == pytest.approx(expected, rel=1e-4)


def test_srgb_colours(curves):
    found = values(curves, attribute="shade", srgb=True)[:, 0]
    encoded = np.maximum(curves.attributes["shade"].astype(float), 1e-6)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    expected = [sigma_ca_from_colour([max(c, 1e-6)] * 3, FIBRE.beta_n_deg)[0] for c in linear]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-7)


def test_variation_is_by_strand_and_by_seed(rng):
    many = Curves.from_arrays(rng.normal(size=(20_000, 2, 3)), 0.1)

    def of(**table):
        absorption = Absorption(variation=0.4, **table)
        return absorption.roots(many, MODEL, FIBRE.replace(sigma_ca=2.0), "fur") ** 2

    found = of()
    assert found.shape == (20_000, 3)
    normal = np.log(found[:, 0] / 2.0) / 0.4
    assert (
        stats.kstest(normal[np.abs(normal) < 2.99], stats.truncnorm(-2.99, 2.99).cdf).pvalue > 1e-3
    )
    assert stats.kstest(1.1 * normal, stats.norm.cdf).pvalue < 1e-3
    assert np.abs(normal).max() <= 3.0 + 1e-3
    np.testing.assert_array_equal(of(), found)
    assert not np.array_equal(of(seed=1), found)
    elsewhere = Absorption(variation=0.4).roots(many, MODEL, FIBRE.replace(sigma_ca=2.0), "brows")
    assert np.corrcoef(elsewhere[:, 0], np.sqrt(found[:, 0]))[0, 1] < 0.03


def decoded(packed):
    """Square roots (n, 3) by the description in kernels/include/fibre/absorption.clh."""
    words = packed.words
    n, before = int(words[1]), ABSORPTION_HEADER + int(words[3])
    levels = np.stack([words[before:] & 2047, words[before:] >> 11 & 2047, words[before:] >> 22], 1)
    assert len(levels) == n
    return levels / LEVELS * float(words[:1].view(np.float32)[0])


def test_words_are_near_their_values(curves):
    grooms = Grooms([Groom("fur", curves)])
    packed = bind(Absorption(attribute="tint"), MODEL, FIBRE, grooms, 0)
    roots = np.sqrt(values(curves, attribute="tint"))
    assert packed.by == "strand"
    assert not packed.grey
    assert np.abs(decoded(packed) - roots).max() <= 0.5 / 1023 * roots.max() * 1.001
    np.testing.assert_allclose(packed.sigma, decoded(packed).max(axis=0) ** 2)
    assert packed.absorbs == (decoded(packed).min() ** 2, decoded(packed).max() ** 2)
    blocks = -(-curves.n_points // RANK_VERTICES)
    assert len(packed.words) == ABSORPTION_HEADER + blocks + curves.n_strands


def test_points_where_any_groom_has_them(curves):
    other = Curves.from_arrays(
        curves.points[:14], 0.1, [0, 7, 14], attributes={"tint": np.full((14, 3), 0.5)}
    )
    grooms = Grooms([Groom("a", curves, 1), Groom("b", other, 1), Groom("c", other, 0)])
    packed = bind(Absorption(attribute="tint"), MODEL, FIBRE, grooms, 1)
    assert packed.by == "point"
    assert list(packed.words[1:4]) == [curves.n_points + 14, 14, 0]
    found = decoded(packed)
    np.testing.assert_array_equal(found[:7], np.tile(found[0], (7, 1)))
    assert np.abs(found[-14:] - found[-1]).max() == 0.0


def test_one_value_is_a_constant(curves):
    grooms = Grooms([Groom("fur", curves)])
    ramp = Absorption(ramp=((0.3,), (0.3,)), quantity="sigma")
    packed = bind(ramp, MODEL, FIBRE, grooms, 0)
    assert packed.by == "constant"
    assert packed.grey
    assert packed.sigma == pytest.approx((0.3, 0.3, 0.3))


BAD = {
    "no such attribute": ({"attribute": "hue"}, GroomError, "groom has none .* tint, shade"),
    "three numbers for a ramp": (
        {"attribute": "tint", "ramp": ((0.1,), (1.0,))},
        GroomError,
        "3 numbers a value, a ramp",
    ),
    "three numbers for melanin": (
        {"attribute": "tint", "quantity": "melanin"}, GroomError, "wants 1 number or 2 numbers",
    ),
    "outside the ramp": (
        {"attribute": "age", "ramp": ((0.1,), (1.0,))}, GroomError, "the ramp from 0 to 1; extend",
    ),
    "colours above 1": ({"attribute": "age"}, GroomError, "a colour is from 0 to 1; divide them"),
    "nothing": ({}, ValueError, "absorption follows nothing"),
    "one value": ({"ramp": ((1.0,),)}, ValueError, "at least two values"),
    "uneven values": ({"ramp": ((1.0,), (1.0, 1.0, 1.0))}, ValueError, "all alike"),
    "two numbers for a colour": ({"ramp": ((1.0, 1.0), (1.0, 1.0))}, ValueError, "1 number or 3"),
    "places": ({"ramp": ((1.0,), (1.0,)), "at": (1.0, 0.0)}, ValueError, "2 increasing numbers"),
    "places alone": ({"attribute": "age", "at": (1.0, 2.0)}, ValueError, "there is no ramp"),
    "a ramp outside its range": ({"ramp": ((2.0,), (1.0,))}, ValueError, "a colour is from 0 to 1"),
    "srgb of sigma": (
        {"ramp": ((1.0,), (1.0,)), "quantity": "sigma", "srgb": True}, ValueError, "no sRGB curve",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_values_are_refused(curves, name):
    table, error, message = BAD[name]
    with pytest.raises(error, match=message):
        values(curves, **table)


def test_a_model_without_absorption_refuses_colours(curves):
    class Other(DoubleCylinder):
        absorption_of_colour = FibreModel.absorption_of_colour

    with pytest.raises(FibreError, match="has no absorption for a colour"):
        Absorption(attribute="tint").roots(curves, Other(), FIBRE, "fur")


def test_a_scene_gives_the_colour_once():
    fibre = {"preset": "red", "sigma_ca": 1.0, "absorption": {"attribute": "tint"}}
    with pytest.raises(SceneError, match=r"fibre.* the colour is given by sigma_ca and absorption"):
        even_patch(fibre)
    even_patch({"sigma_ca": 1.0, "absorption": {"variation": 0.2}})


# Pictures.

CLEAR = {"preset": "human-black", "kappa": 0.0}
LIGHT, DARK = (0.2, 0.2, 0.4), (3.0, 2.0, 1.0)


def patch(absorption, sampling="full-cdf"):
    scene = even_patch({**CLEAR, "absorption": absorption})
    return with_overrides(scene, [f"render.sampling={sampling}"], spp=64)


@pytest.fixture
def picture(device):
    def rendered(scene, grooms):
        renderer = Renderer(scene, device, curves=grooms)
        renderer.advance(scene.render.spp)
        return renderer

    return rendered


def two_materials():
    """The patch with a light and a dark material instead of values of strands."""
    document = msgspec.to_builtins(even_patch())
    curves = document.pop("curves")
    del document["fibre"]
    document["material"] = {
        name: {**CLEAR, "sigma_ca": sigma} for name, sigma in (("light", LIGHT), ("dark", DARK))
    }
    document["groom"] = {name: {"curves": curves, "material": name} for name in ("light", "dark")}
    return with_overrides(decode_scene(document), spp=64)


def tuft(of_points=False):
    """The patch, every other strand dark; and the same by two materials."""
    whole = even_patch().build_curves()
    dark = np.arange(whole.n_strands) % 2 == 1
    sigma = np.where(dark[:, None], [DARK], [LIGHT]).astype(np.float32)
    if of_points:
        sigma = np.repeat(sigma, np.diff(whole.offsets), axis=0)
    valued = Curves.from_arrays(
        whole.points, whole.radii, whole.offsets, attributes={"sigma": sigma}
    )
    parts = [Groom("ab"[m], whole.with_strands(dark == bool(m), "x"), m) for m in (0, 1)]
    return Grooms([Groom("fur", valued)]), Grooms(parts)


BY_VALUE = {"attribute": "sigma", "quantity": "sigma"}


def check_picture(picture, of_points, sampling="full-cdf", seed=0) -> None:
    """The mean of all pixels, channel by channel, within 4 errors of the picture with two
    materials, which has other random paths."""
    valued, parts = tuft(of_points)
    of_values = picture(patch(BY_VALUE, sampling), valued).image()
    of_materials = picture(with_overrides(two_materials(), seed=seed + 1), parts).image()
    difference = (of_values.rgb - of_materials.rgb).astype(np.float64).mean(axis=(0, 1))
    variance = (of_values.variance + of_materials.variance).astype(np.float64).sum(axis=(0, 1))
    error = np.sqrt(variance) / of_values.rgb[..., 0].size
    assert np.all(np.abs(difference) < 4.0 * error)


@pytest.mark.parametrize("sampling", ["full-cdf", "uniform-h"])
@pytest.mark.parametrize("of_points", [False, True])
def test_strands_of_two_colours_are_two_materials(picture, of_points, sampling):
    check_picture(picture, of_points, sampling)


PICTURE_MUTANTS = {
    "the colour of the next strand": (
        False, r"rank \+ popcount\(a.ends\[", "rank + 1u - popcount(a.ends[",
    ),
    "channels in the wrong order": (False, r"word & 0x7ffu\)", "word >> 21 & 0x7ffu)"),
    "a root that is not squared": (True, r"scaled \* scaled, 0.0f", "scaled, 0.0f"),
}  # fmt: skip


@pytest.mark.parametrize("name", PICTURE_MUTANTS)
def test_wrong_values_are_seen(picture, monkeypatch, name):
    of_points, pattern, text = PICTURE_MUTANTS[name]
    substitute(monkeypatch, pattern, text, "stages/shade.cl")
    with pytest.raises(AssertionError):
        check_picture(picture, of_points)


def test_values_of_strands_and_of_their_points_are_the_same_picture(picture):
    by_strand, by_point = (
        picture(patch(BY_VALUE), tuft(of_points)[0]) for of_points in (False, True)
    )
    assert [r.materials[0].features.absorption for r in (by_strand, by_point)] == [
        "strand",
        "point",
    ]
    assert np.array_equal(by_strand.image().rgb, by_point.image().rgb)
    curves = by_point.setup.grooms[0]
    blocks = -(-(curves.segments + curves.strands) // RANK_VERTICES)
    words = ABSORPTION_HEADER + np.array(
        [curves.strands + blocks, curves.segments + curves.strands]
    )
    found = [r.stats()["bytes"]["absorption"] for r in (by_strand, by_point)]
    assert found == (4 * words).tolist()


def test_values_behind_another_material(picture):
    """The strands with values are not the first: their vertices and ranks begin in a block of
    others. Bits are those of the same values by point."""
    whole = even_patch().build_curves()
    first = np.arange(whole.n_strands) < 45
    rng = np.random.default_rng(5)
    rest = whole.with_strands(~first, "x")
    sigma = rng.uniform(0.1, 3.0, (rest.n_strands, 3))
    scene = two_materials()
    document = msgspec.to_builtins(scene)
    document["material"]["dark"] = {**CLEAR, "absorption": BY_VALUE}
    scene = with_overrides(decode_scene(document), spp=16)
    pictures = []
    for array in (sigma, np.repeat(sigma, np.diff(rest.offsets), axis=0)):
        valued = Curves.from_arrays(
            rest.points, rest.radii, rest.offsets, attributes={"sigma": array}
        )
        grooms = Grooms([Groom("a", whole.with_strands(first, "x"), 0), Groom("b", valued, 1)])
        pictures.append(picture(scene, grooms).image().rgb)
    assert np.array_equal(*pictures)


def test_a_ramp_of_one_value_costs_nothing(picture):
    scene = patch({"ramp": ((0.5,), (0.5,)), "quantity": "sigma"})
    renderer = picture(scene, None)
    assert renderer.material.features.absorption == "constant"
    assert renderer.stats()["bytes"]["absorption"] == 0
    assert renderer.material.fibre.sigma_ca == pytest.approx((0.5, 0.5, 0.5))
    assert renderer.features.channels == 1


def test_grey_values_need_one_channel(picture):
    renderer = picture(patch({"ramp": ((0.5,), (2.0,)), "quantity": "sigma"}), None)
    assert renderer.features.channels == 1
    assert renderer.material.features.absorption == "point"


def test_tables_of_absorptions_have_their_size(device):
    constant = Probe(FIBRE.replace(sigma_ca=1.0), "attenuation-cdf", device)
    given = Probe(FIBRE.replace(sigma_ca=1.0), "attenuation-cdf", device, absorbs=RANGE)
    assert constant.material.tables is not None
    tables = constant.material.tables.packed.nbytes
    rows = 4 * (2 + ABSORPTION_NODES * len(constant.material.tables.energy))
    assert given.memory.bytes["material"] - constant.memory.bytes["material"] == (
        (ABSORPTION_NODES - 1) * tables + rows
    )


# Files.


def test_arrays_of_files(tmp_path, curves, caplog):
    save_curves(curves, tmp_path / "fur.npz")
    again = load_curves(tmp_path / "fur.npz")
    assert set(again.attributes) == {"tint", "shade", "age"}
    for name, array in curves.attributes.items():
        np.testing.assert_array_equal(again.attributes[name], array)
    arrays = {"points": curves.points.reshape(90, 7, 3), "radius": 0.1}
    odd = {"labels": np.array(["x"] * 90), "other": np.zeros(11), "objects": np.array([{}])}
    np.savez(tmp_path / "odd.npz", **arrays, **odd, shade=np.zeros((90, 7)))
    read = load_curves(tmp_path / "odd.npz")
    assert sorted(read.ignored) == ["labels", "objects", "other"]
    assert read.attributes["shade"].shape == (630,)
    save_curves(curves, tmp_path / "fur.hair")
    assert "no place for tint, shade, age" in caplog.text


def test_arrays_without_a_use_are_named_once(tmp_path, device, curves, caplog):
    save_curves(curves, tmp_path / "fur.npz")
    scene = decode_scene(
        {
            "fibre": {**CLEAR, "absorption": {"attribute": "tint"}},
            "film": {"width": 2, "height": 2},
            "environment": {"kind": "constant"},
            "curves": {"generator": "file", "file": str(tmp_path / "fur.npz")},
            "render": INDEPENDENT,
        }
    )
    assert of_scene(scene)["unused arrays"] == "shade, age"
    assert of_groom(tmp_path / "fur.npz", curves)["arrays"].startswith(
        "tint (of strands, 3 numbers), shade"
    )
    caplog.set_level("INFO")
    Renderer(scene, device).advance(1)
    assert [r.message for r in caplog.records if "nothing uses" in r.message] == [
        "groom groom: nothing uses its shade, age"
    ]
