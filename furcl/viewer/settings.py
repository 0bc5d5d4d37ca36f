"""The scene as a page has changed it."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import msgspec

from furcl.errors import SceneError
from furcl.fibre import model as models
from furcl.scene.camera import Camera
from furcl.scene.overrides import apply_overrides
from furcl.scene.read import decode_scene, with_overrides
from furcl.scene.tables import Scene
from furcl.values import shown
from furcl.viewer import messages
from furcl.viewer.camera import dollied, orbited, shifted
from furcl.viewer.fields import OTHER_COLOURS, key_of

#: Presets that models are tried with, the first that they have.
FIRST_PRESETS = ("brown",)
MOST_PIXELS = 1 << 24


@dataclass(frozen=True)
class Settings:
    """What is rendered.

    Attributes
    ----------
    original : Scene        as it was read
    scene : Scene           with what was changed, its own camera
    camera : Camera or None     resolved, where it was moved by hand
    """

    original: Scene
    scene: Scene
    camera: Camera | None = None

    def seen(self) -> Scene:
        """The scene with the camera where it was moved to: what is saved."""
        if self.camera is None:
            return self.scene
        if not self.scene.cameras:
            return msgspec.structs.replace(self.scene, camera=self.camera)
        name = self.scene.film.camera or next(iter(self.scene.cameras))
        cameras = {**self.scene.cameras, name: self.camera}
        return msgspec.structs.replace(self.scene, cameras=cameras)

    def rendered(self) -> Scene:
        """The scene that a changing picture is made of: without layers, all pixels alike."""
        scene = self.seen()
        film = msgspec.structs.replace(scene.film, layers=(), background="light")
        render = msgspec.structs.replace(scene.render, allocation="even", variance=True)
        return msgspec.structs.replace(scene, film=film, render=render)

    def with_value(self, key: str, value: Any) -> Settings:
        """With a key of the scene set to a JSON value.

        Another preset of a fibre takes its numbers away, an absorption the colour that stood for
        it; another model begins with a preset. A text is taken as `--set` takes it.

        Raises
        ------
        SceneError      an unknown key, or a value outside its range
        """
        text = value if isinstance(value, str) else _toml(key, value)
        table, name = self._fibre_of(key)
        if table is None:
            return self._changed(with_overrides(self.scene, [f"{key}={text}"]), key)
        changes = [f"{key}={text}"]
        if name == "model":
            changes += _begun_with(table, text)
        document = apply_overrides(msgspec.to_builtins(self.scene), changes)
        fibre = _at(document, table)
        if name == "preset":
            kept = ("model", "mode", "preset")
            fibre.update(dict.fromkeys(fibre.keys() - kept))
        elif name == models.find(fibre["model"]).absorbed:
            fibre.update(dict.fromkeys(fibre.keys() & OTHER_COLOURS))
        return self._changed(decode_scene(document, f"scene {self.scene.name!r}"), key)

    def without(self, key: str | None) -> Settings:
        """With a key as it was read; None: with all of them, and the camera.

        Raises
        ------
        SceneError      an unknown key
        """
        if key is None:
            return Settings(self.original, self.original)
        document = msgspec.to_builtins(self.scene)
        original = msgspec.to_builtins(self.original)
        *outer, last = key.split(".")
        here, there = _at(document, ".".join(outer)), _at(original, ".".join(outer))
        if last in there:
            here[last] = there[last]
        else:
            here.pop(last, None)
        return self._changed(decode_scene(document, f"scene {self.scene.name!r}"), key)

    def with_crop(self, box: tuple[int, int, int, int] | None) -> Settings:
        """With a window of the picture, or None: all of it.

        Raises
        ------
        SceneError      a window without pixels of the picture
        """
        document = msgspec.to_builtins(self.scene)
        document["film"]["crop"] = None if box is None else list(box)
        return self._changed(decode_scene(document, f"scene {self.scene.name!r}"), "film.crop")

    def with_camera(self, camera: Camera | None) -> Settings:
        """Seen by a resolved camera; None: by that of the scene."""
        return replace(self, camera=camera)

    def changed_keys(self) -> list[str]:
        """Dotted keys whose values differ from those that were read."""
        return _differing(msgspec.to_builtins(self.original), msgspec.to_builtins(self.scene))

    def _changed(self, scene: Scene, key: str) -> Settings:
        of_camera = key.partition(".")[0] in ("camera", "cameras") or key == "film.camera"
        return replace(self, scene=scene, camera=None if of_camera else self.camera)

    def _fibre_of(self, key: str) -> tuple[str | None, str]:
        """The table of a fibre that holds a key, and what is left of the key."""
        for material in self.scene.materials():
            table = key_of(self.scene, material)
            if key.startswith(f"{table}."):
                return table, key.removeprefix(f"{table}.")
        return None, key


def _toml(key: str, value: Any) -> str:
    """A JSON value as TOML."""
    if isinstance(value, bool | int | float | list):
        try:
            return json.dumps(value, allow_nan=False)
        except ValueError:
            pass
    raise SceneError(f"{key} = {shown(value)}: expected a number, a text or a list of numbers")


def _begun_with(table: str, model: str) -> list[str]:
    """The preset that a model which was just chosen begins with."""
    presets = models.find(model).table.allowed.get("preset", ())
    first = [name for name in FIRST_PRESETS if name in presets] or list(presets)[:1]
    return [f"{table}.preset={name}" for name in first]


def _at(document: dict[str, Any], key: str) -> dict[str, Any]:
    """The table of a document at a dotted key.

    Raises
    ------
    SceneError      there is none
    """
    table: Any = document
    for part in key.split(".") if key else ():
        table = table.get(part) if isinstance(table, dict) else None
    if not isinstance(table, dict):
        raise SceneError(f"{shown(key)}: the scene has no such table")
    return table


def _differing(a: Any, b: Any, key: str = "") -> list[str]:
    if isinstance(a, dict) and isinstance(b, dict):
        names = list(dict.fromkeys([*a, *b]))
        inner = [_differing(a.get(n), b.get(n), f"{key}.{n}" if key else n) for n in names]
        return [found for keys in inner for found in keys]
    return [] if a == b else [key]


def changed_by(settings: Settings, message: messages.Message, seen_by: Camera | None) -> Settings:
    """Settings as a message asks for.

    Parameters
    ----------
    seen_by : Camera or None    resolved, that which sees the picture

    Raises
    ------
    SceneError      a value that is not allowed
    """
    match message:
        case messages.Set(key, value):
            changed = settings.with_value(key, value)
        case messages.Reset(key):
            changed = settings.without(key)
        case messages.Crop(box):
            changed = settings.with_crop(box)
        case messages.ResetCamera():
            changed = settings.with_camera(None)
        case messages.Orbit() | messages.Move() | messages.Dolly():
            camera = settings.camera or seen_by
            if camera is None:
                raise SceneError("there is no picture yet; wait for the first")
            changed = settings.with_camera(_moved(camera, message))
        case _:
            return settings
    film = changed.scene.film
    if film.width * film.height > MOST_PIXELS:
        raise SceneError(
            f"film.width x film.height = {film.width} x {film.height}: the view takes "
            f"{MOST_PIXELS} pixels; make it smaller, and render larger pictures with furcl render"
        )
    return changed


def _moved(camera: Camera, message: messages.Orbit | messages.Move | messages.Dolly) -> Camera:
    match message:
        case messages.Orbit(azimuth, elevation):
            return orbited(camera, azimuth, elevation)
        case messages.Move(right, up):
            return shifted(camera, right, up)
        case messages.Dolly(factor):
            return dollied(camera, factor)
