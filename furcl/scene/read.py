"""Reading scene files and overriding their values, with messages that name file and key."""

from __future__ import annotations

import copy
import difflib
import os
import re
import tomllib
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal, NoReturn

import msgspec

from furcl.errors import FibreError, SceneError
from furcl.scene.tables import Scene, scene_type

Document = dict[str, Any]

# Values that name files: in a scene file relative to it, in an override to the current directory.
FILE_KEYS = (("curves", "file"), ("environment", "file"))
_KEYWORDS = {
    "spp": "render.spp",
    "seed": "render.seed",
    "sampling": "render.sampling",
    "max_depth": "render.max_depth",
}


def load_scene(
    path: str | os.PathLike[str], *, overrides: Iterable[str] = (), **keywords: Any
) -> Scene:
    """Read a TOML scene.

    Parameters
    ----------
    path : path                 of the scene file; relative files in it are sought beside it
    overrides : list of str     "dotted.key=VALUE", see `apply_overrides`
    spp, seed, sampling, max_depth : replace the value of that name in the table [render]
    size : (w, h) or "WxH"      replaces width and height in [film]
                                (a keyword that is None changes nothing)

    Returns
    -------
    Scene                       decoded strictly, file names absolute, the fibre checked

    Raises
    ------
    SceneError                  unknown key (with the nearest known one), value outside its range,
                                missing file, bad TOML; the message starts with file name and key
    """
    path = Path(path)
    try:
        document = tomllib.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise SceneError(f"{path}: there is no such scene file; check the path") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}; give a TOML scene") from None
    except UnicodeDecodeError as error:
        raise SceneError(
            f"{path}: byte {error.start} is not UTF-8; a scene is a TOML text, is this a groom?"
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not valid TOML: {error}; correct the file") from None
    document = _absolute_files(document, path.absolute().parent)
    document.setdefault("name", path.stem)
    document = apply_overrides(document, [*overrides, *_as_overrides(keywords)])
    return decode_scene(document, str(path))


def with_overrides(scene: Scene, overrides: Iterable[str] = (), **keywords: Any) -> Scene:
    """A copy of a scene with values replaced as by `load_scene`, checked again.

    Raises
    ------
    SceneError      as `load_scene`
    """
    changes = [*overrides, *_as_overrides(keywords)]
    if not changes:
        return scene
    document = apply_overrides(msgspec.to_builtins(scene), changes)
    return decode_scene(document, f"scene {scene.name!r}")


def apply_overrides(document: Document, overrides: Iterable[str]) -> Document:
    """A copy of a scene document with values replaced.

    Parameters
    ----------
    document : dict             tables as `tomllib` gives them
    overrides : list of str     "dotted.key=VALUE" with a TOML value; text that is no TOML value is
                                a string, so quotes may be left out. Relative files are sought in
                                the current directory.

    Raises
    ------
    SceneError      if one has no "=", or goes through a value that is no table
    """
    document = copy.deepcopy(document)
    for override in overrides:
        dotted, equals, text = override.partition("=")
        keys = tuple(key.strip() for key in dotted.split("."))
        if not equals or not all(keys):
            raise SceneError(
                f"override {override!r}: expected KEY=VALUE with a dotted key, "
                f"for example render.spp=16 or curves.file=groom.hair"
            )
        table = document
        for depth, key in enumerate(keys[:-1], 1):
            if table.get(key) is None:
                table[key] = {}
            table = table[key]
            if not isinstance(table, dict):
                raise SceneError(
                    f"override {override!r}: {'.'.join(keys[:depth])} is a value, not a table; "
                    f"set it without a further key"
                )
        value = _toml_value(text)
        if keys in FILE_KEYS and isinstance(value, str):
            value = str(Path(value).absolute())
        table[keys[-1]] = value
    return document


def decode_scene(document: Document, source: str = "scene") -> Scene:
    """Check a scene document and make a Scene of it.

    Parameters
    ----------
    document : dict     tables as `tomllib` gives them, file names absolute
    source : str        the file's name for messages

    Raises
    ------
    SceneError          as `load_scene`
    """
    curves = document.get("curves")
    if isinstance(curves, dict) and "generator" not in curves:
        document = {**document, "curves": {"generator": "file", **curves}}
    known = scene_type()
    _refuse_unknown(document, known, "", source)
    try:
        decoded = msgspec.convert(document, known)
    except msgspec.ValidationError as error:
        _refuse(str(error), document, source)
    scene = Scene(**{name: getattr(decoded, name) for name in Scene.__struct_fields__})
    for table, key in FILE_KEYS:
        file = getattr(getattr(scene, table), key, None)
        if file is not None and not Path(file).is_file():
            raise SceneError(
                f"{source}: {table}.{key} = {file!r}: there is no such file; correct the path "
                f"(relative ones are sought beside the scene file, those of --set where you are)"
            )
    try:
        scene.build_fibre()
    except FibreError as error:
        raise SceneError(f"{source}: {error}") from None
    return scene


def _as_overrides(keywords: dict[str, Any]) -> list[str]:
    changes = []
    for name, value in keywords.items():
        if name != "size" and name not in _KEYWORDS:
            raise TypeError(f"unknown keyword {name!r}; allowed are size, {', '.join(_KEYWORDS)}")
        if value is None:
            continue
        if name != "size":
            changes.append(f"{_KEYWORDS[name]}={value}")
            continue
        size = value.lower().split("x") if isinstance(value, str) else list(value)
        if len(size) != 2 or not all(str(n).strip().isdigit() for n in size):
            raise SceneError(f"size = {value!r}: expected WxH in pixels, for example 640x480")
        changes += [f"film.width={size[0]}", f"film.height={size[1]}"]
    return changes


def _toml_value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _absolute_files(document: Document, folder: Path) -> Document:
    document = copy.deepcopy(document)
    for table, key in FILE_KEYS:
        values = document.get(table)
        if isinstance(values, dict) and isinstance(values.get(key), str):
            values[key] = str(folder / values[key])
    return document


def _structs_in(hint: Any) -> list[type[msgspec.Struct]]:
    """The struct types that a field's type allows."""
    parts = typing.get_args(hint) if isinstance(hint, types.UnionType) else [hint]
    return [p for p in parts if isinstance(p, type) and issubclass(p, msgspec.Struct)]


def _choose(structs: list[type[msgspec.Struct]], table: Any) -> type[msgspec.Struct] | None:
    """The one of several tagged structs that a table says it is; None if it says none of them."""
    if len(structs) == 1:
        return structs[0]
    for struct in structs:
        config = struct.__struct_config__
        if isinstance(table, dict) and table.get(config.tag_field) == config.tag:
            return struct
    return None


def _fields(struct: type[msgspec.Struct]) -> dict[str, Any]:
    return {field.name: field.type for field in msgspec.structs.fields(struct)}


def _refuse_unknown(table: Any, struct: type[msgspec.Struct], where: str, source: str) -> None:
    if not isinstance(table, dict):
        return
    fields = _fields(struct)
    config = struct.__struct_config__
    known = [*fields, *([config.tag_field] if config.tag_field else [])]
    for key, value in table.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, 1, 0.6)
            kind = f" with {config.tag_field} = {config.tag!r}" if config.tag_field else ""
            raise SceneError(
                f"{source}: unknown key {where}{key}{kind}"
                + (f"; did you mean {where}{near[0]}?" if near else "")
                + f" Known are {', '.join(known)}."
            )
        structs = _structs_in(fields.get(key))
        chosen = _choose(structs, value) if structs else None
        if chosen is not None:
            _refuse_unknown(value, chosen, f"{where}{key}.", source)


def _refuse(message: str, document: Document, source: str) -> NoReturn:
    """Turn msgspec's message and path into one that starts with file, key and value."""
    what, _, path = message.partition(" - at `$")
    keys = re.findall(r"\.(\w+)|\[(\d+)\]", path)
    value: Any = document
    hint: Any = scene_type()
    for name, index in keys:
        if index:
            value, hint = value[int(index)], None
            continue
        struct = _choose(_structs_in(hint), value)
        hint = None if struct is None else _fields(struct).get(name)
        if struct is None or hint is None:
            tagged = _structs_in(hint) or _tagged_by(name)
            hint = Literal[*[s.__struct_config__.tag for s in tagged]] if tagged else None
        value = value.get(name) if isinstance(value, dict) else None
    where = ".".join(f"[{index}]" if index else name for name, index in keys).replace(".[", "[")
    missing = re.search(r"missing required field `(\w+)`", what)
    if missing:
        key = f"{where}.{missing[1]}" if where else missing[1]
        raise SceneError(
            f"{source}: {key} is missing; add it to the file or give --set {key}=VALUE"
        )
    if re.match(r"\w+ = ", what):  # a table's own check, which names its key
        raise SceneError(f"{source}: {where}.{what}")
    if not where:
        raise SceneError(f"{source}: {what}")
    choices = typing.get_args(hint) if typing.get_origin(hint) is Literal else ()
    if choices:
        near = difflib.get_close_matches(str(value), choices, 1, 0.5)
        what = f"allowed are {', '.join(choices)}" + (
            f"; did you mean {near[0]!r}?" if near else ""
        )
    elif what.startswith("Expected"):
        what = "e" + what[1:]
    shown = "" if isinstance(value, dict) else f" = {value!r}"
    raise SceneError(f"{source}: {where}{shown}: {what}")


def _tagged_by(field: str) -> list[type[msgspec.Struct]]:
    """The structs of the scene that the key `field` tells apart."""
    hints = [hint for hint in _fields(scene_type()).values() if len(_structs_in(hint)) > 1]
    return [s for h in hints for s in _structs_in(h) if s.__struct_config__.tag_field == field]
