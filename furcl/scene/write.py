"""Scenes as TOML text."""

from __future__ import annotations

from typing import Any

import msgspec

from furcl.scene.tables import Scene


def scene_text(scene: Scene) -> str:
    """A TOML text that `furcl.load_scene` reads as this scene; what has its default is left out.

    Files have absolute names. Needs the package tomli-w.
    """
    import tomli_w

    return tomli_w.dumps(_document(scene))


def _document(table: msgspec.Struct) -> dict[str, Any]:
    """The keys of a table that differ from their defaults, and that which tells its kind."""
    config = table.__struct_config__
    out: dict[str, Any] = {config.tag_field: config.tag} if config.tag_field else {}
    for field in msgspec.structs.fields(table):
        value = getattr(table, field.name)
        if value is None or (not field.required and value == _default(field)):
            continue
        out[field.name] = _plain(value)
    return out


def _plain(value: Any) -> Any:
    if isinstance(value, msgspec.Struct):
        return _document(value)
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(each) for each in value]
    return value


def _default(field: msgspec.structs.FieldInfo) -> Any:
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return field.default
