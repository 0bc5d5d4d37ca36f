"""Reading scene files, with messages that name file and key."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from errno import ENAMETOOLONG, ENOENT, ENOTDIR
from pathlib import Path
from typing import Any

import msgspec

from furcl.errors import FibreError, SceneError
from furcl.files import check_regular, named, open_regular
from furcl.paths import scene_folder
from furcl.scene.document import MAX_BYTES, parse_toml
from furcl.scene.overrides import Document, absolute_files, apply_overrides, keyword_overrides
from furcl.scene.refusal import check_tables, refuse_missing, refuse_value
from furcl.scene.schema import files_in
from furcl.scene.tables import KINDS, Scene
from furcl.values import shown


def find_scene(name: str | os.PathLike[str]) -> Path:
    """The file of that name; where there is none, the scene of that name which comes with furcl.

    Raises
    ------
    SceneError      no file can have that name
    """
    path = named(name, SceneError)
    shipped = (scene_folder() / path.name).with_suffix(".toml")
    return shipped if not path.exists() and path.parent == Path() and shipped.exists() else path


def load_scene(
    path: str | os.PathLike[str], *, overrides: Iterable[str] = (), **keywords: Any
) -> Scene:
    """Read a TOML scene.

    Parameters
    ----------
    path : path                 of the scene file, or the name of one that comes with furcl, such as
                                black_hair; relative files in it are sought beside it
    overrides : list of str     "dotted.key=VALUE", see `furcl.scene.overrides.apply_overrides`
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
    path = find_scene(path)
    document = _read(path)
    absolute_files(document, path.absolute().parent)
    document.setdefault("name", path.stem)
    document = apply_overrides(document, [*overrides, *keyword_overrides(keywords)])
    return decode_scene(document, str(path))


def _read(path: Path) -> Document:
    try:
        with open_regular(path) as file:
            return parse_toml(file.read(MAX_BYTES + 1).decode("utf-8-sig"))
    except FileNotFoundError:
        raise SceneError(f"{path}: there is no such scene file; {_where_else(path)}") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}; give a TOML scene") from None
    except UnicodeDecodeError as error:
        raise SceneError(
            f"{path}: byte {error.start} is not UTF-8; a scene is a TOML text, is this a groom?"
        ) from None
    except ValueError as error:
        raise SceneError(f"{path}: not valid TOML: {error}; correct the file") from None


def _where_else(path: Path) -> str:
    """What to do about a scene that is not there."""
    shipped = sorted(scene.stem for scene in scene_folder().glob("*.toml"))
    near = difflib.get_close_matches(path.stem, shipped, 1, 0.6)
    if near:
        return f"did you mean {near[0]}, which comes with furcl?"
    return f"check the path, or give one of furcl's: {', '.join(shipped)}"


def with_overrides(scene: Scene, overrides: Iterable[str] = (), **keywords: Any) -> Scene:
    """A copy of a scene with values replaced as by `load_scene`, checked again.

    Raises
    ------
    SceneError      as `load_scene`
    """
    changes = [*overrides, *keyword_overrides(keywords)]
    if not changes:
        return scene
    document = apply_overrides(msgspec.to_builtins(scene), changes)
    return decode_scene(document, f"scene {scene.name!r}")


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
    document = {name: _with_kind(name, table) for name, table in document.items()}
    check_tables(document, source)
    values = {}
    for field in msgspec.structs.fields(Scene):
        if field.name in document:
            value = document[field.name]
            kinds = KINDS.get(field.name)
            if value is None and field.default is None:
                continue
            try:
                values[field.name] = msgspec.convert(
                    value, kinds.type_of(value) if kinds else field.type
                )
            except msgspec.ValidationError as error:
                refuse_value(str(error), document, field.name, source)
        elif field.required:
            refuse_missing(field.name, source)
    for keys, table in files_in(document):
        name = table[keys[-1]]
        try:
            check_regular(name)
        except (OSError, ValueError) as error:  # of names that no file can have
            absent = getattr(error, "errno", None) in (None, ENOENT, ENOTDIR, ENAMETOOLONG)
            reason = "there is no such file" if absent else getattr(error, "strerror", "")
            raise SceneError(
                f"{source}: {'.'.join(keys)} = {shown(name)}: {reason}; correct the path (relative "
                f"ones are sought beside the scene file, those of --set where you are)"
            ) from None
    scene = Scene(**values)
    try:
        scene.build_fibre()
    except FibreError as error:
        raise SceneError(f"{source}: {error}") from None
    return scene


def _with_kind(name: str, table: Any) -> Any:
    """A table that says its kind, if it is one that may leave it out."""
    kinds = KINDS.get(name)
    if kinds is None or kinds.default is None or not isinstance(table, dict):
        return table
    return {kinds.tag: kinds.default, **table}
