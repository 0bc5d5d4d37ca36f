"""Several grooms with several materials in one picture."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_mutants import substitute
from scene_documents import INDEPENDENT

from furcl.bench.features import preprocessed
from furcl.cli.facts import of_scene
from furcl.device.features import Features
from furcl.errors import GroomError, SceneError
from furcl.groom.curves import Curves
from furcl.groom.joined import Groom, Grooms
from furcl.rendering.renderer import Renderer
from furcl.scene.read import decode_scene, with_overrides

DARK = {"preset": "human-black", "kappa": 0.0, "layers": 0.5, "sigma_ca": 3.0}
LIGHT = {"preset": "human-black", "kappa": 0.0, "layers": 0.5, "sigma_ca": 0.2}
FUR = {
    "generator": "fur", "surface": "patch", "n_strands": 200, "length": 0.3, "radius": 0.03,
    "patch_size": [0.8, 1.0], "lean_deg": 0.0, "bend_deg": 0.0,
}  # fmt: skip
LEFT, RIGHT = {"translate": [-0.5, 0.0, 0.0]}, {"translate": [0.5, 0.0, 0.0]}


def two_grooms(left="light", right="light", materials=(LIGHT, DARK), **tables):
    """Two patches beside each other, seen from above, 16 x 8 pixels."""
    return decode_scene(
        {
            "camera": {"origin": [0.0, 0.0, 2.2], "target": [0, 0, 0], "up": [0, 1, 0]},
            "film": {"width": 16, "height": 8, "filter": "box"},
            "material": dict(zip(("light", "dark"), materials, strict=True)),
            "environment": {"kind": "constant"},
            "groom": {
                "left": {"curves": FUR, "material": left, "transform": LEFT},
                "right": {"curves": {**FUR, "seed": 2}, "material": right, "transform": RIGHT},
            },
            "render": {"spp": 16, **INDEPENDENT},
            **tables,
        },
        "two",
    )


@pytest.fixture
def picture(device):
    def rendered(scene, curves=None):
        renderer = Renderer(scene, device, curves=curves)
        renderer.advance(scene.render.spp)
        return renderer.image()

    return rendered


def cut(curves: Curves) -> list[Curves]:
    """A groom in two halves."""
    first = np.arange(curves.n_strands) < curves.n_strands // 2
    return [curves.with_strands(half, "others") for half in (first, ~first)]


def test_a_groom_in_two_parts_is_the_same_picture(picture):
    """To the bit, whether the parts have one material or two with the same parameters: paths take
    other queues, and the same random numbers."""
    scene = two_grooms(right="dark", materials=(LIGHT, LIGHT))
    one, two = scene.build_curves(), Grooms([Groom("a", c, 0) for c in cut(scene.build_curves())])
    whole = picture(scene, Grooms([Groom("all", one)]))
    assert np.array_equal(picture(scene, two).rgb, whole.rgb)
    halves = picture(scene, Grooms([Groom("ab"[i], c, i) for i, c in enumerate(cut(one))]))
    assert np.array_equal(halves.rgb, whole.rgb)
    assert halves.stats["lobes"] == whole.stats["lobes"]
    hits = [material["hits"] for material in halves.stats["materials"]]
    assert min(hits) > 100
    assert sum(hits) == sum(halves.stats["lobes"].values())
    assert sum(hits) == whole.stats["materials"][0]["hits"]


def check_materials(picture) -> None:
    """With one bounce a pixel is of the groom that it shows, in that one's material, to the bit."""
    once = {"render": {"spp": 16, "max_depth": 1, **INDEPENDENT}}
    mixed = picture(two_grooms("light", "dark", **once)).rgb
    turned = picture(two_grooms("dark", "light", **once)).rgb
    light = picture(two_grooms("light", "light", **once)).rgb
    dark = picture(two_grooms("dark", "dark", **once)).rgb
    assert np.abs(light - dark).mean() > 0.05
    assert np.array_equal(mixed[:, :8], light[:, :8])
    assert np.array_equal(mixed[:, 8:], dark[:, 8:])
    assert np.array_equal(turned[:, :8], dark[:, :8])
    assert np.array_equal(turned[:, 8:], light[:, 8:])


def test_each_groom_has_its_material(picture):
    check_materials(picture)


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        (r"vertex >= starts\[i\] \? 1u : 0u", "vertex >= starts[i] ? 0u : 1u"),
        (r"vertex >= starts\[i\] \? 1u : 0u", "2u * vertex >= starts[i] ? 1u : 0u"),
    ],
)
def test_a_wrong_material_is_seen(picture, monkeypatch, pattern, text):
    """The first mutant swaps the materials, the second begins one too early."""
    substitute(monkeypatch, pattern, text, "stages/intersect.cl")
    with pytest.raises(AssertionError):
        check_materials(picture)


def test_one_material_compiles_and_allocates_as_ever(device):
    scene = two_grooms()
    one, two = Renderer(scene, device), Renderer(two_grooms(right="dark"), device)
    for renderer, expected in ((one, False), (two, True)):
        texts = map(preprocessed, renderer.wavefront.texts())
        assert any("material_of_vertex" in text for text in texts) == expected
    assert "material starts" not in one.memory.bytes
    assert two.memory.bytes["queues hits"] == 2 * one.memory.bytes["queues hits"]
    # Materials that need the same of the kernels share a build.
    assert len(two.wavefront.texts()) == len(one.wavefront.texts())
    assert Features().hit_queues == 1


def test_transforms_place_strands_and_scale_radii():
    plain = two_grooms().groom["left"].curves.build()
    scene = with_overrides(
        two_grooms(),
        [
            "groom.left.transform.scale=2.0",
            "groom.left.transform.rotate_deg=[0, 0, 90]",
        ],
    )
    placed = scene.build_grooms().grooms[0].curves
    x, y, z = plain.points.astype(np.float64).T
    expected = np.stack([-2.0 * y - 0.5, 2.0 * x, 2.0 * z], 1)
    np.testing.assert_allclose(placed.points, expected, atol=1e-6)
    np.testing.assert_array_equal(placed.radii, 2.0 * plain.radii)


def test_a_transform_that_radii_cannot_follow_is_refused():
    scene = with_overrides(two_grooms(), ["groom.left.transform.scale=[1, 2, 1]"])
    with pytest.raises(SceneError, match=r"groom.left.transform scales by 1, 2, 1"):
        scene.build_grooms()


def test_grooms_are_joined_in_the_order_of_their_materials(rng):
    strands = [Curves.from_arrays(rng.normal(size=(n, 4, 3)), 0.1 * n) for n in (3, 2, 5)]
    grooms = Grooms([Groom(str(i), strands[i], material) for i, material in enumerate((1, 0, 1))])
    assert [groom.name for groom in grooms.grooms] == ["1", "0", "2"]
    assert grooms.first_strands == [0, 2, 5]
    assert grooms.first_points == [0, 8, 20]
    assert grooms.material_starts(3) == [0, 8, 40]
    joined = grooms.curves
    np.testing.assert_array_equal(joined.offsets, 4 * np.arange(11))
    np.testing.assert_array_equal(joined.points[8:20], strands[0].points)
    np.testing.assert_allclose(np.unique(joined.radii), [0.2, 0.3, 0.5])


def test_a_strand_of_another_groom_is_there_once(rng):
    points = rng.normal(size=(6, 4, 3))
    one, two = (Curves.from_arrays(points[part], 0.1) for part in (slice(0, 4), slice(2, 6)))
    traced = Grooms([Groom("one", one, 1), Groom("two", two, 0)]).traced()
    assert {g.name: g.curves.n_strands for g in traced.grooms} == {"two": 4, "one": 2}
    assert dict(traced.curves.dropped) == {"copied_strands": 2}
    whole = Grooms([Groom("one", one, 1), Groom("same", one, 0)]).traced()
    assert [groom.name for groom in whole.grooms] == ["same"]
    assert whole.material_starts(2) == [0, 16]


def test_too_many_points_together(monkeypatch, rng):
    monkeypatch.setattr("furcl.groom.joined.MAX_POINTS", 20)
    one = Curves.from_arrays(rng.normal(size=(4, 4, 3)), 0.1)
    with pytest.raises(GroomError, match="grooms a, b: 32 points together; at most 20"):
        Grooms([Groom("a", one), Groom("b", one)])


def test_statistics_and_facts_tell_grooms_apart(picture):
    scene = two_grooms(right="dark")
    stats = picture(scene).stats
    assert [(g["name"], g["material"], g["strands"]) for g in stats["grooms"]] == [
        ("left", "light", 200),
        ("right", "dark", 200),
    ]
    assert [m["name"] for m in stats["materials"]] == ["light", "dark"]
    assert stats["segments"] == sum(g["segments"] for g in stats["grooms"]) == 2800
    facts = of_scene(scene)
    assert facts["groom left"] == "200 strands, 1400 segments of light"
    assert "sigma_ca 0.2," in facts["light: fibre"]
    assert "sigma_ca 3," in facts["dark: fibre"]


def test_a_material_without_a_groom_is_named():
    said = [text for name, text in of_scene(two_grooms()).items() if name.startswith("warning")]
    assert any("material dark" in text and "no groom" in text for text in said)
    assert not any("no groom" in text for text in of_scene(two_grooms(right="dark")).values())
