"""Kinds of tables that are registered from outside: a scene takes them like furcl's own."""

from __future__ import annotations

import pickle
from types import SimpleNamespace
from typing import Annotated

import msgspec
import numpy as np
import pytest
from msgspec import Meta
from scene_documents import MINIMAL

from furcl.errors import GroomError, SceneError
from furcl.fibre import model as models
from furcl.groom import kinds
from furcl.groom.curves import Curves
from furcl.groom.tables import BUILT_IN, CurvesTable
from furcl.scene import tables
from furcl.scene.read import decode_scene, load_scene, with_overrides
from furcl.table import Table

MODELS = models.names()
"""furcl's own: nothing else is registered yet."""


class Ladder(CurvesTable, frozen=True, kw_only=True, tag="ladder"):
    """Rungs above each other."""

    rungs: Annotated[int, Meta(ge=1, le=9)] = 2
    plan_file: str | None = None

    def build(self) -> Curves:
        z = np.arange(self.rungs)
        ends = [np.stack([np.full_like(z, x), 0 * z, z], axis=1) for x in (0, 1)]
        points = np.stack(ends, axis=1).astype(np.float32)
        return Curves.from_arrays(points, 0.1)


class Lamp(Table, frozen=True, kw_only=True, tag_field="kind", tag="lamp"):
    """A light."""

    watts: float = 60.0


class Glass(Table, frozen=True, kw_only=True, tag_field="model", tag="glass"):
    """A fibre model."""

    eta: Annotated[float, Meta(ge=1.0, le=3.0)] = 1.5

    def build(self) -> SimpleNamespace:
        return SimpleNamespace(eta=self.eta)


@pytest.fixture
def registered(monkeypatch):
    """The three of them, for the length of a test."""
    kinds.register(Ladder)
    for key, table in (("environment", Lamp), ("fibre", Glass)):
        known = tables.KINDS[key]
        name = str(table.__struct_config__.tag)
        more = {**known.tables(), name: table}
        monkeypatch.setitem(tables.KINDS, key, tables.Kinds(known.tag, more.copy, known.default))
    yield
    kinds.unregister("ladder")


def test_scenes_take_what_is_registered(registered, tmp_path):
    (tmp_path / "mine.toml").write_text(
        """
        [fibre]
        model = "glass"
        eta = 1.25
        [environment]
        kind = "lamp"
        [curves]
        generator = "ladder"
        rungs = 3
        """
    )
    scene = load_scene(tmp_path / "mine.toml", overrides=["environment.watts=5"])
    assert scene.environment == Lamp(watts=5.0)
    assert scene.build_fibre().eta == 1.25
    assert scene.build_curves().n_strands == 3
    assert decode_scene(msgspec.to_builtins(scene)) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert with_overrides(scene, ["curves.rungs=1"]).build_curves().n_strands == 1
    changed = with_overrides(scene, ["fibre.model=double-cylinder", "fibre.preset=raccoon"])
    assert changed.build_fibre().kappa == 0.64


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["curves.generator=ladder", "curves.rungs=10"], "curves.rungs = 10: expected `int` <= 9"),
        (["curves.generator=ladder", "curves.rung=1"], "did you mean curves.rungs?"),
        (["curves.generator=laddr"], "did you mean 'ladder'?"),
        (["curves.generator=ladder", "curves.plan_file=no.txt"], "there is no such file"),
        (["environment.kind=lamb"], "allowed are constant, sky, image, lamp; did you mean 'lamp'?"),
        (["environment.kind=lamp", "environment.watt=1"], "did you mean environment.watts?"),
        (
            ["fibre.model=glas"],
            f"allowed are {', '.join(MODELS)}, glass; did you mean 'glass'?",
        ),
        (["fibre.model=glass", "fibre.eta=0.5"], "fibre.eta = 0.5: expected `float` >= 1.0"),
        (
            ["fibre.model=glass", "fibre.preset=raccoon"],
            f"model = {' or '.join(map(repr, MODELS))} has it.",
        ),
    ],
)
def test_they_are_checked_as_strictly(registered, changes, message):
    scene = decode_scene(MINIMAL)
    with pytest.raises(SceneError) as caught:
        with_overrides(scene, changes)
    assert message in str(caught.value)


def test_without_registration_they_are_unknown():
    with pytest.raises(
        SceneError, match="'ladder': allowed are file, interpolate, hair, fur, fibre"
    ):
        decode_scene({**MINIMAL, "curves": {"generator": "ladder"}})


def test_bad_registrations_of_generators():
    class Untagged(CurvesTable, frozen=True, kw_only=True):
        """No tag."""

    for table in (Untagged, Lamp):
        with pytest.raises(GroomError, match="is no table of a groom; declare it as class"):
            kinds.register(table)  # pyright: ignore[reportArgumentType]
    with pytest.raises(GroomError, match="'fur': the name is one of furcl's own"):
        kinds.register(BUILT_IN["fur"])
    with pytest.raises(GroomError, match="'ladder' was not registered"):
        kinds.unregister("ladder")
    with pytest.raises(GroomError, match="'fur' was not registered"):
        kinds.unregister("fur")


@pytest.mark.parametrize(
    "curves", [name for name in BUILT_IN if name not in ("file", "interpolate")]
)
def test_scenes_are_pickled_with_any_groom(curves):
    scene = decode_scene({**MINIMAL, "curves": {"generator": curves}})
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene
    assert again.build_fibre() == scene.build_fibre()
    assert hash(again) == hash(scene)
