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
from furcl.scene.camera import Camera
from furcl.scene.document import MAX_BYTES, parse_toml
from furcl.scene.from_groom import groom_document, is_groom
from furcl.scene.overrides import Document, absolute_files, apply_overrides, keyword_overrides
from furcl.scene.refusal import check_tables, refuse_missing, refuse_value
from furcl.scene.schema import files_in, named_tables
from furcl.scene.tables import NAMED, Groom, Keys, Scene, kinds_at
from furcl.values import printable, shown

LONGEST_NAME = 255


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
    """Read a TOML scene, or make one of a groom file (furcl.scene.from_groom).

    Parameters
    ----------
    path : path                 of the scene file, or the name of one that comes with furcl, such as
                                black_hair; relative files in it are sought beside it. Of a groom, a
                                scene that frames it under a sky
    overrides : list of str     "dotted.key=VALUE", see `furcl.scene.overrides.apply_overrides`
    spp, seed, sampling, max_depth : replace the value of that name in the table [render]
    camera : str                replaces film.camera
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
    document = groom_document(path) if is_groom(path) else named_lists(_read(path), str(path))
    absolute_files(document, path.absolute().parent)
    document.setdefault("name", printable(path.stem))
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
    document = named_lists(document, source)
    document = {name: _with_kinds(table, (name,)) for name, table in document.items()}
    check_tables(document, source)
    _check_name(document.get("name"), source)
    scene = _decoded(document, Scene, (), document, source)
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
    if scene.environment is None and not scene.lamp and not scene.has_bright_meshes:
        raise SceneError(
            f"{source}: environment is missing; add it, a lamp or a mesh with emission to the "
            f"file, or give --set environment.kind=constant"
        )
    _check_grooms(scene, source)
    _check_cameras(scene, source)
    return scene


def _check_name(name: object, source: str) -> None:
    """Refuse a scene's name that a line of text cannot show, in logs, tables and headers."""
    if isinstance(name, str) and (len(name) > LONGEST_NAME or printable(name) != name):
        raise SceneError(
            f"{source}: name = {shown(name)}: expected at most {LONGEST_NAME} printable characters"
        )


def named_lists(document: Document, source: str) -> Document:
    """A scene document in which lists of tables that have names, [[groom]], are tables by name,
    [groom.NAME]; one that says no name is called by its place, groom1. Those of a list [[camera]]
    are [cameras.NAME], since [camera] is the only one.

    Raises
    ------
    SceneError      a name twice, or one that is no text
    """
    out = {
        "cameras" if (key, type(value)) == ("camera", list) else key: value
        for key, value in document.items()
    }
    for key in NAMED & out.keys():
        if not isinstance(out[key], list) or not all(isinstance(t, dict) for t in out[key]):
            continue
        tables: Document = {}
        single = key.removesuffix("s")
        for number, table in enumerate(out[key], 1):
            name = table.get("name", f"{single}{number}")
            if not isinstance(name, str) or name in tables:
                raise SceneError(
                    f"{source}: {single}[{number - 1}].name = {shown(name)}: expected a text that "
                    f"no other {single} has"
                )
            tables[name] = {k: value for k, value in table.items() if k != "name"}
        out[key] = tables
    return out


def _decoded(table: Any, hint: Any, at: Keys, document: Document, source: str) -> Any:
    """The value of a type that part of a document stands for; kinds of tables are looked up."""
    kinds, named = kinds_at(at), named_tables(hint)
    if kinds is None and named and isinstance(table, dict):
        return {
            name: _decoded(each, named, (*at, name), document, source)
            for name, each in table.items()
        }
    if hint in (Scene, Groom) and isinstance(table, dict):
        values = {}
        for field in msgspec.structs.fields(hint):
            keys = (*at, field.name)
            if field.name not in table:
                if field.required:
                    refuse_missing(".".join(keys), source)
            elif table[field.name] is not None or field.default is not None:
                values[field.name] = _decoded(table[field.name], field.type, keys, document, source)
        try:
            return hint(**values)
        except ValueError as error:
            raise SceneError(f"{source}: {'.'.join(at)}.{error}") from None
    try:
        return msgspec.convert(table, kinds.type_of(table) if kinds else hint)
    except msgspec.ValidationError as error:
        refuse_value(str(error), document, at, source)


def _check_grooms(scene: Scene, source: str) -> None:
    """Refuse a scene without a groom, and a groom without a fibre that can be built.

    Raises
    ------
    SceneError
    """
    if scene.curves is not None and scene.groom:
        raise SceneError(
            f"{source}: curves is given beside groom.{next(iter(scene.groom))}; [curves] is the "
            f"short form of one groom: make it a [groom.NAME] with a table curves"
        )
    if scene.curves is None and not scene.groom:
        refuse_missing("curves", source)
    for name, groom in scene.groom.items():
        if groom.material is not None and groom.material not in scene.material:
            known = ", ".join(scene.material) or "none"
            raise SceneError(
                f"{source}: groom.{name}.material = {shown(groom.material)}: the scene has no "
                f"material of that name; known: {known}"
            )
        if groom.fibre is None and groom.material is None and scene.fibre is None:
            raise SceneError(
                f"{source}: groom.{name} has no fibre; give it a material, a table fibre of its "
                f"own, or the scene a [fibre]"
            )
    if scene.curves is not None and scene.fibre is None:
        refuse_missing("fibre", source)
    fibres = {
        "": scene.fibre,
        **{f" material.{name}:": material for name, material in scene.material.items()},
        **{f" groom.{name}:": groom.fibre for name, groom in scene.groom.items()},
    }
    for where, fibre in fibres.items():
        try:
            if fibre is not None:
                fibre.build()
        except FibreError as error:
            raise SceneError(f"{source}:{where} {error}") from None


def _check_cameras(scene: Scene, source: str) -> None:
    """Refuse a name of no camera, and a camera beside several.

    Raises
    ------
    SceneError
    """
    if scene.cameras and scene.camera != Camera():
        raise SceneError(
            f"{source}: camera is given beside cameras.{next(iter(scene.cameras))}; [camera] is "
            f"the short form of one: give its values to one of them, as cameras.NAME.KEY"
        )
    if scene.film.camera is not None and scene.film.camera not in scene.cameras:
        known = ", ".join(scene.cameras) or "none: give [[camera]] with a name"
        raise SceneError(
            f"{source}: film.camera = {shown(scene.film.camera)}: the scene has no camera of that "
            f"name; known: {known}"
        )


def _with_kinds(table: Any, at: Keys) -> Any:
    """A table in which all say their kinds that may leave them out."""
    if not isinstance(table, dict):
        return table
    kinds = kinds_at(at)
    out = {key: _with_kinds(value, (*at, key)) for key, value in table.items()}
    return out if kinds is None or kinds.default is None else {kinds.tag: kinds.default, **out}
