"""Tables that scenes name: grooms and materials, as [groom.NAME] or as a list with names."""

from __future__ import annotations

import pickle

import msgspec
import pytest
from scene_documents import minimal

from furcl.errors import SceneError
from furcl.scene.overrides import apply_overrides
from furcl.scene.read import decode_scene, load_scene, with_overrides

TWO = """
[environment]
kind = "constant"

[[material]]
name = "dark"
preset = "human-black"

[[material]]
model = "double-cylinder"
preset = "human-white"

[[groom]]
name = "scalp"
material = "dark"
curves = {generator = "hair", n_strands = 10}

[[groom]]
material = "material2"
transform = {translate = [0, 0, 1], scale = 2}
[groom.curves]
generator = "file"
file = "brows.hair"
"""


@pytest.fixture
def two(tmp_path):
    (tmp_path / "brows.hair").write_bytes(b"HAIR")
    path = tmp_path / "two.toml"
    path.write_text(TWO)
    return path


def presets(scene):
    """The preset of each groom's fibre."""
    return {name: msgspec.to_builtins(g.fibre)["preset"] for name, g in scene.grooms().items()}


def test_lists_are_tables_by_name(two, tmp_path):
    scene = load_scene(two, overrides=["groom.scalp.curves.n_strands=20"])
    assert list(scene.groom) == ["scalp", "groom2"]
    assert list(scene.material) == ["dark", "material2"]
    curves = {name: msgspec.to_builtins(groom.curves) for name, groom in scene.groom.items()}
    assert curves["scalp"]["n_strands"] == 20
    assert curves["groom2"]["file"] == str(tmp_path / "brows.hair")
    assert scene.groom["groom2"].transform.scale == 2.0
    assert presets(scene) == {"scalp": "human-black", "groom2": "human-white"}
    assert decode_scene(msgspec.to_builtins(scene)) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(pickle.loads(pickle.dumps(scene))) == hash(scene)


def test_overrides_reach_named_tables(two):
    scene = load_scene(
        two,
        overrides=[
            "groom.groom2.curves.generator=fur",
            "groom.groom2.curves.n_strands=7",
            "material.dark.preset=raccoon",
            "groom.beard.curves.generator=fibre",
            "groom.beard.material=dark",
        ],
    )
    assert msgspec.to_builtins(scene.groom["groom2"].curves)["n_strands"] == 7
    assert presets(scene)["beard"] == "raccoon"
    assert presets(with_overrides(scene, ["groom.beard.material=material2"]))["beard"] == (
        "human-white"
    )


def test_the_last_kind_of_a_named_table_counts():
    before = {"groom": {"a": {"curves": {"generator": "hair", "n_strands": 5}}}}
    changes = ["groom.a.curves.generator=fur", "groom.a.curves.generator=hair"]
    assert apply_overrides(before, changes) == before


def test_the_short_form_is_one_groom():
    scene = decode_scene(minimal())
    assert list(scene.grooms()) == ["groom"]
    assert scene.grooms()["groom"].curves == scene.curves


FIBRE = {"preset": "human-black"}
GROOM = {"curves": {"generator": "fibre"}}
BAD = [
    ({"groom": {"a": GROOM}}, "curves is given beside groom.a; [curves] is the short form"),
    ({"curves": None}, "curves is missing"),
    ({"curves": None, "groom": {"a": {}}}, "groom.a.curves is missing"),
    (
        {"curves": None, "groom": 3},
        "groom = 3: expected a table, for example groom.NAME; its keys are names",
    ),
    ({"curves": None, "groom": {"a": 3}}, "groom.a = 3: expected a table"),
    ({"curves": None, "groom": {"a b": GROOM}}, "groom.a b: a name has letters, digits, _ and -"),
    ({"curves": None, "groom": {"../a": GROOM}}, "groom.../a: a name has letters"),
    (
        {"curves": None, "groom": [{**GROOM, "name": "a"}, {**GROOM, "name": "a"}]},
        "groom[1].name = 'a': expected a text that no other groom has",
    ),
    ({"curves": None, "groom": [{**GROOM, "name": 3}]}, "groom[0].name = 3: expected a text"),
    (
        {"curves": None, "groom": {"a": {**GROOM, "curve": 1}}},
        "unknown key groom.a.curve; did you mean groom.a.curves?",
    ),
    (
        {"curves": None, "groom": {"a": {"curves": {"generator": "fuhr"}}}},
        "groom.a.curves.generator = 'fuhr': allowed are",
    ),
    (
        {"curves": None, "groom": {"a": {"curves": {"generator": "fur", "n_strands": 0}}}},
        "groom.a.curves.n_strands = 0: expected `int` >= 1",
    ),
    (
        {"curves": None, "groom": {"a": {**GROOM, "material": "b"}}, "material": {"c": FIBRE}},
        "groom.a.material = 'b': the scene has no material of that name; known: c",
    ),
    (
        {
            "curves": None,
            "groom": {"a": {**GROOM, "material": "b", "fibre": FIBRE}},
            "material": {"b": FIBRE},
        },
        "groom.a.material = 'b' is given beside fibre; give one or the other",
    ),
    ({"curves": None, "fibre": None, "groom": {"a": GROOM}}, "groom.a has no fibre; give it"),
    (
        {"curves": None, "groom": {"a": {**GROOM, "transform": {"scale": 0}}}},
        "groom.a.transform.scale = 0.0: it flattens",
    ),
    ({"material": {"a": {"preset": "rad"}}}, "material.a: fibre.preset = 'rad' is not known"),
    (
        {"curves": None, "groom": {"a": {**GROOM, "fibre": {"preset": "rad"}}}},
        "groom.a: fibre.preset = 'rad' is not known",
    ),
]


@pytest.mark.parametrize(("tables", "message"), BAD, ids=[m for _, m in BAD])
def test_bad_tables_are_refused_by_name(tables, message):
    with pytest.raises(SceneError) as caught:
        decode_scene(minimal(**tables), "a.toml")
    assert str(caught.value).startswith("a.toml: ")
    assert message in str(caught.value)


CAMERAS = {
    "camera": [
        {"name": "front", "azimuth_deg": 0.0},
        {"name": "side", "azimuth_deg": 90.0, "aperture_radius": 0.1},
        {"projection": "orthographic"},
    ]
}


@pytest.mark.parametrize(("chosen", "azimuth"), [(None, 0.0), ("front", 0.0), ("side", 90.0)])
def test_one_of_several_cameras_is_chosen_by_name(chosen, azimuth):
    scene = with_overrides(decode_scene(minimal(**CAMERAS)), camera=chosen)
    assert list(scene.cameras) == ["front", "side", "camera3"]
    assert scene.chosen_camera.azimuth_deg == azimuth
    assert with_overrides(scene, spp=3).chosen_camera == scene.chosen_camera
    alone = scene.seen_by(scene.chosen_camera)
    assert with_overrides(alone, spp=3).chosen_camera == scene.chosen_camera


def test_values_of_a_named_camera_are_replaced():
    scene = with_overrides(decode_scene(minimal(**CAMERAS)), ["cameras.side.vfov_deg=5"])
    assert scene.cameras["side"].vfov_deg == 5.0


@pytest.mark.parametrize(
    ("tables", "overrides", "words"),
    [
        (CAMERAS, ["film.camera=back"], r"film\.camera = 'back'.*known: front, side, camera3"),
        ({}, ["film.camera=front"], r"film\.camera = 'front'.*known: none"),
        (CAMERAS, ["camera.vfov_deg=5"], r"camera is given beside cameras\.front"),
        (
            {"camera": [{"name": "a"}, {"name": "a"}]},
            [],
            r"camera\[1\]\.name = 'a'.*no other camera",
        ),
        ({"camera": [{"name": "a", "vfov": 3}]}, [], r"unknown key cameras\.a\.vfov.*vfov_deg"),
    ],
)
def test_cameras_that_are_not_clear_are_refused(tables, overrides, words):
    with pytest.raises(SceneError, match=words):
        with_overrides(decode_scene(minimal(**tables)), overrides)
