"""What each key of a scene document is: the type that its tables give it."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Union

import msgspec
from msgspec import Meta

from furcl.scene.tables import Keys, Kinds, Scene, kinds_at

Struct = msgspec.Struct

_PLAIN = (int, float, str)


def fields(struct: type[Struct]) -> dict[str, Any]:
    """Key -> type of its value, for all keys of a table."""
    config = struct.__struct_config__
    tag = {config.tag_field: Literal[config.tag]} if config.tag_field else {}
    return {**tag, **{field.name: field.type for field in msgspec.structs.fields(struct)}}


def table_type(kinds: Kinds | None, hint: Any, table: object) -> type[Struct] | None:
    """The type of the table that a value is to be; None if it is not to be one, or not known which.

    Parameters
    ----------
    kinds : Kinds or None   what the table may be, where the value itself says which it is
    hint : type             of the value
    """
    if kinds is not None:
        return kinds.type_of(table)
    return next((part for part in _parts(hint) if _is_struct(part)), None)


def type_at(document: object, keys: Keys) -> Any:
    """The type of the value that dotted keys of a scene document name; None if nothing is known."""
    hint: Any = Scene
    for depth, key in enumerate(keys):
        kinds = kinds_at(keys[:depth])
        if kinds and key == kinds.tag:
            return str
        if named := named_tables(hint):
            hint = named
        else:
            struct = table_type(kinds, hint, document)
            hint = None if struct is None else fields(struct).get(key)
        document = document.get(key) if isinstance(document, dict) else None
    return hint


def named_tables(hint: Any) -> Any:
    """The type of each of the tables that a table of named ones holds; None if it is not such."""
    return typing.get_args(hint)[1] if typing.get_origin(hint) is dict else None


def is_text(hint: Any) -> bool:
    """Whether a value of that type is text and nothing else."""
    kinds = [part for part in _parts(hint) if part is not type(None)]
    return bool(kinds) and all(
        part is str
        or (typing.get_origin(part) is Literal and isinstance(typing.get_args(part)[0], str))
        for part in kinds
    )


def allows_none(hint: Any) -> bool:
    """Whether a value of that type may be left out by None."""
    return type(None) in _parts(hint)


def choices(hint: Any) -> tuple[str, ...]:
    """The words that a type allows; none if it is no choice of words."""
    each = [
        typing.get_args(part)[0] if Ellipsis in typing.get_args(part) else part
        for part in _parts(hint)
    ]
    literals = [part for part in each if typing.get_origin(part) is Literal]
    return tuple(word for literal in literals for word in typing.get_args(literal))


def example(struct: type[Struct]) -> str:
    """A key of a table with a value, for messages."""
    known = msgspec.structs.fields(struct)
    shown = [(field.name, value) for field in known for value in _examples(field.type)]
    plain = [(field.name, field.default) for field in known if type(field.default) in _PLAIN]
    name, value = [*shown, *plain, (known[0].name, "VALUE")][0]
    return f"{name}={value}"


def files_in(document: object, where: Keys = ()) -> Iterator[tuple[Keys, dict[str, Any]]]:
    """Where a document names files: keys, and the table that holds the last one.

    A text is a file's name if its key is `file` or ends with `_file`.
    """
    if not isinstance(document, dict):
        return
    for key, value in document.items():
        if isinstance(value, str) and (key == "file" or key.endswith("_file")):
            yield (*where, key), document
        yield from files_in(value, (*where, key))


def files_of(scene: Scene) -> list[Path]:
    """The files that a scene names."""
    return [Path(table[keys[-1]]) for keys, table in files_in(msgspec.to_builtins(scene))]


def _parts(hint: Any) -> list[Any]:
    """The types that a type allows, without what restricts their values."""
    if typing.get_origin(hint) is Annotated:
        return _parts(typing.get_args(hint)[0])
    if typing.get_origin(hint) in (Union, types.UnionType):
        return [part for allowed in typing.get_args(hint) for part in _parts(allowed)]
    return [hint]


def _is_struct(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, Struct)


def _examples(hint: Any) -> list[Any]:
    metas = typing.get_args(hint)[1:] if typing.get_origin(hint) is Annotated else ()
    return [value for meta in metas if isinstance(meta, Meta) for value in meta.examples or ()]
