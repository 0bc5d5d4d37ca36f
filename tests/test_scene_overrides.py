"""Values of scenes that are replaced by `--set` and keywords, and how what is wrong is refused."""

from __future__ import annotations

import itertools
from pathlib import Path

import msgspec
import numpy as np
import pytest

from furcl.errors import SceneError
from furcl.fibre import samplers
from furcl.fibre.pigment import sigma_ca_from_melanin
from furcl.image.exr import write_exr
from furcl.light.constant import ConstantEnvironment
from furcl.light.image import ImageEnvironment
from furcl.light.sky import SkyEnvironment
from furcl.scene.overrides import apply_overrides
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Film

MINIMAL = """
[fibre]
preset = "human-black"

[environment]
kind = "constant"
radiance = 2.0

[curves]
generator = "fibre"
count = 3
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(MINIMAL)
    return path


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    write_exr(tmp_path / "light.exr", dict.fromkeys("RGB", np.ones((2, 4), np.float32)), {})
    return tmp_path / "light.exr"


def test_keywords_replace_values(scene_file):
    scene = load_scene(scene_file, spp=3, seed=9, size="40x30", sampling="uniform-h", max_depth=7)
    render = scene.render
    assert (render.spp, render.seed, render.sampling, render.max_depth) == (3, 9, "uniform-h", 7)
    assert (scene.film.width, scene.film.height) == (40, 30)
    assert with_overrides(scene, size=(8, 4), spp=None).film == Film(width=8, height=4)
    with pytest.raises(TypeError, match="unknown keyword 'samples'"):
        load_scene(scene_file, samples=3)


def test_overrides_take_toml_values_and_bare_words(scene_file):
    scene = load_scene(
        scene_file,
        overrides=[
            "render.spp=16",
            "environment.radiance=[1, 2.5, 3]",
            "film.filter=tent",
            'name="quoted = name"',
            "fibre.melanin.eumelanin=2",
            "body.albedo=0.5",
        ],
    )
    assert scene.render.spp == 16
    assert scene.environment == ConstantEnvironment(radiance=(1.0, 2.5, 3.0))
    assert scene.film.filter == "tent"
    assert scene.name == "quoted = name"
    assert scene.build_fibre().sigma_ca == sigma_ca_from_melanin(2.0)
    assert scene.body is not None


def test_overrides_leave_the_document_alone():
    before = {"fibre": {"preset": "human-black"}, "environment": {"kind": "sky"}}
    after = apply_overrides(before, ["render.spp=2", "fibre.kappa=0.5", "environment.kind=image"])
    assert before == {"fibre": {"preset": "human-black"}, "environment": {"kind": "sky"}}
    assert after["render"] == {"spp": 2}


SWITCHES = [
    (["environment.kind=sky"], SkyEnvironment()),
    (["environment.kind='sky'", "environment.turbidity=5"], SkyEnvironment(turbidity=5.0)),
    (["environment.kind=constant"], ConstantEnvironment(radiance=2.0)),  # what it was already
    (["environment.kind=sky", "environment.kind=constant"], ConstantEnvironment(radiance=2.0)),
    (["environment.kind=constant", "environment.kind=sky"], SkyEnvironment()),
]


@pytest.mark.parametrize(("overrides", "expected"), SWITCHES)
@pytest.mark.parametrize("of_a_file", [True, False])
def test_a_kind_that_is_switched_takes_the_other_keys_away(
    scene_file, overrides, expected, of_a_file
):
    if of_a_file:
        scene = load_scene(scene_file, overrides=overrides)
    else:
        scene = with_overrides(load_scene(scene_file), overrides)
    assert scene.environment == expected


def test_keys_of_the_new_kind_may_stand_before_or_after_it(scene_file, picture, monkeypatch):
    monkeypatch.chdir(picture.parent)
    changes = ["environment.kind=image", "environment.file=light.exr", "environment.scale=3"]
    expected = ImageEnvironment(file=str(picture), scale=3.0)
    for order in itertools.permutations(changes):
        assert load_scene(scene_file, overrides=order).environment == expected


def test_generators_are_switched_too(scene_file):
    scene = load_scene(scene_file, overrides=["curves.surface=patch", "curves.generator=fur"])
    curves = msgspec.to_builtins(scene.curves)
    assert curves["generator"] == "fur"
    assert curves["surface"] == "patch"
    again = with_overrides(scene, ["curves.generator=fibre"])
    assert again.build_curves().n_strands == 1


def test_keys_of_the_former_kind_are_unknown_then(scene_file):
    changes = ["environment.kind=sky", "environment.radiance=1"]
    with pytest.raises(SceneError, match=r"radiance with kind = 'sky'; kind = 'constant' has it\."):
        load_scene(scene_file, overrides=changes)


@pytest.mark.parametrize("name", ["nan", "inf", "true", "1e3", "1979-01-01", "0x10", "[a]", "{}"])
def test_text_is_text_whatever_toml_makes_of_it(scene_file, name, monkeypatch):
    known = samplers.find("full-cdf")
    monkeypatch.setattr(samplers, "find", lambda wanted: known if wanted == name else None)
    for scene in (
        load_scene(scene_file, sampling=name),
        load_scene(scene_file, overrides=[f"render.sampling={name}"]),
        load_scene(scene_file, overrides=[f'render.sampling="{name}"', f"name='{name}'"]),
    ):
        assert scene.render.sampling == name
    assert scene.name == name
    with pytest.raises(SceneError, match=r"fibre\.preset = .* is not known"):
        load_scene(scene_file, overrides=[f"fibre.preset={name}"])
    with pytest.raises(SceneError, match=r"film\.filter = .*: allowed are box, tent, gaussian"):
        load_scene(scene_file, overrides=[f"film.filter={name}"])


@pytest.mark.parametrize(
    ("key", "shown"),
    [
        ("fibre.melanin", "fibre.melanin.eumelanin=1.3"),
        ("fibre", "fibre.preset=human-black"),
        ("environment", "environment.kind=constant"),
        ("curves", "curves.file=groom.hair"),
        ("camera", "camera.vfov_deg=30.0"),
        ("film", "film.width=512"),
        ("render", "render.spp=64"),
        ("body", "body.albedo=0.05"),
    ],
)
def test_a_value_where_a_table_is_expected(scene_file, key, shown):
    """The example that is given can be set as it is; the keys, or what says which, follow."""
    with pytest.raises(SceneError) as caught:
        load_scene(scene_file, overrides=[f"{key}=1"])
    assert f"{key} = 1: expected a table, for example {shown}; " in str(caught.value)
    assert shown.split("=")[0].split(".")[-1] in str(caught.value).split("; ")[-1]
    if key != "curves":  # its file does not exist
        load_scene(scene_file, overrides=[shown])


def test_messages_are_sentences(scene_file):
    for key, nearest in (("render.xyz", "."), ("render.sp", "; did you mean render.spp?")):
        with pytest.raises(SceneError) as caught:
            load_scene(scene_file, overrides=[f"{key}=1"])
        assert f"unknown key {key}{nearest} Known are spp, seed, " in str(caught.value)
        assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("render.spp", "expected KEY=VALUE with a dotted key"),
        ("=3", "expected KEY=VALUE"),
        ("render..spp=3", "expected KEY=VALUE"),
        ("fibre.preset.x=3", "fibre.preset is a value, not a table"),
        ("render.spp=many", "render.spp = 'many': expected `int`, got `str`"),
        ("render.sp=3", "unknown key render.sp; did you mean render.spp?"),
        (
            "curves.file=none.hair",
            "with generator = 'fibre'; generator = 'file' or 'interpolate' has it.",
        ),
    ],
)
def test_bad_overrides(scene_file, override, message):
    with pytest.raises(SceneError) as caught:
        load_scene(scene_file, overrides=[override])
    assert message in str(caught.value)


@pytest.mark.parametrize("size", ["40", "40x", "axb", (1, 2, 3), "-1x4"])
def test_bad_sizes(scene_file, size):
    with pytest.raises(SceneError, match="expected WxH in pixels"):
        load_scene(scene_file, size=size)
