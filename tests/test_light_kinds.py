"""Kinds of light by name: what registration accepts, how scenes find them, and who knows them."""

from __future__ import annotations

import inspect
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from sphere_lamp import SPHERE, SphereLamp, SphereTable, lit_fibre, registered_lamp

import furcl
from furcl.device.features import Features
from furcl.errors import LightError, SceneError
from furcl.light import kinds
from furcl.light.sky import SkyEnvironment, SkyLight
from furcl.paths import kernel_folder
from furcl.scene.read import decode_scene, with_overrides
from furcl.scene.tables import Scene

PACKAGE = Path(kinds.__file__).parents[1]


def test_names_begin_with_those_of_furcl():
    built_in = ("constant", "sky", "image")
    assert furcl.lights is kinds
    assert kinds.names() == built_in
    with registered_lamp():
        assert kinds.names() == (*built_in, "sphere")
        assert kinds.find("sphere") is SphereLamp
        assert kinds.tables()["sphere"] is SphereTable
    with pytest.raises(LightError, match=r"light 'skye': known are constant.*did you mean 'sky'"):
        kinds.find("skye")
    with pytest.raises(LightError, match="nothing to remove"):
        kinds.unregister("sky")


def _lamp(**changes) -> type[SphereLamp]:
    return type("Changed", (SphereLamp,), changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "sky"}, "choose another"),
        ({"kind": ""}, "choose another"),
        ({"kind": "ball"}, 'tag="ball"'),
        ({"table": SkyEnvironment}, 'tag="sphere"'),
        ({"header": SphereLamp.header.parent / "absent.clh"}, "cannot be read"),
    ],
)
def test_bad_registrations_are_refused(changes, message):
    with pytest.raises(LightError, match=message):
        kinds.register(_lamp(**changes))
    assert kinds.names() == ("constant", "sky", "image")


def test_a_header_without_a_function_is_refused(tmp_path):
    (tmp_path / "half.clh").write_text("light_radiance light_sample")
    with pytest.raises(LightError, match=r"half.clh does not define light_density"):
        kinds.register(_lamp(header=tmp_path / "half.clh"))


@pytest.mark.parametrize("values", [{"RADIANCE": 1.0}, {"RADIANCE": [1, 2, 3], "MORE": 1.0}, {}])
def test_a_buffer_has_what_the_fields_say(values):
    light = kinds.find("constant")(np.ones(3))  # pyright: ignore[reportCallIssue]
    with pytest.raises(LightError, match=r"its fields are {'RADIANCE': 3}"):
        light.parameters(values)


def test_parts_are_values():
    """Equal parts are one key, here and in another process."""
    parts = {SphereLamp.part(), _lamp().part(), SkyLight.part()}
    assert len(parts) == 2
    assert pickle.loads(pickle.dumps(SphereLamp.part())) in parts
    assert SphereLamp.part().defines() == {
        "LIGHT_CENTRE": "0u", "LIGHT_RADIUS": "3u", "LIGHT_RADIANCE": "4u", "LIGHT_SIZE": "7u",
    }  # fmt: skip
    for light, at_infinity in ((SphereLamp, 0), (SkyLight, 1)):
        defines = Features(light=light.part()).defines()
        assert defines["FURCL_LIGHT_AT_INFINITY"] == at_infinity


def test_a_scene_names_a_lamp_from_outside():
    with registered_lamp():
        scene = decode_scene(lit_fibre(SPHERE))
        assert type(scene) is Scene
        assert scene.environment == SphereTable(
            centre=(0.5, -2.0, 1.5), radius=0.4, radiance=(1.0, 2.0, 3.0)
        )
        assert isinstance(scene.build_light(), SphereLamp)
        changed = with_overrides(scene, ["environment.radius=0.25"])
        assert changed.environment == SphereTable(
            centre=(0.5, -2.0, 1.5), radius=0.25, radiance=(1.0, 2.0, 3.0)
        )
        assert pickle.loads(pickle.dumps(scene)) == scene
        for environment, message in (
            ({"kind": "spere"}, "allowed are constant, sky, image, sphere; did you mean 'sphere'"),
            ({**SPHERE, "radius": -1}, r"environment.radius = -1: expected `float` > 0.0"),
            ({**SPHERE, "radios": 1}, "did you mean environment.radius"),
        ):
            with pytest.raises(SceneError, match=message):
                decode_scene(lit_fibre(environment))
    with pytest.raises(SceneError, match="allowed are constant, sky, image"):
        decode_scene(lit_fibre(SPHERE))


@pytest.mark.parametrize("light", kinds.BUILT_IN, ids=[light.kind for light in kinds.BUILT_IN])
def test_a_kind_is_named_by_its_own_files_and_the_list(light):
    """What a new light adds: a file, a header, and its line in furcl/light/kinds.py."""
    names = (
        rf"\b{light.__name__}\b|\b{light.table.__name__}\b|light[./]{light.kind}\b"
        rf"|[\"']kind[\"']: [\"']{light.kind}[\"']|kind=[\"']{light.kind}[\"']"
        rf"|light/{light.kind}\.clh"
    )
    files = [*PACKAGE.rglob("*.py"), *kernel_folder().rglob("*.cl*")]
    own = {Path(inspect.getfile(light)), kernel_folder() / "include" / light.header}
    naming = {file for file in files if re.search(names, file.read_text())}
    # Scenes that furcl makes itself have a light, as those of files have.
    scenes = {PACKAGE / "cli" / "bcsdf.py", PACKAGE / "scene" / "from_groom.py"}
    assert naming - own - scenes == {PACKAGE / "light" / "kinds.py"}
