"""Values of a scene document that are replaced from outside: `--set` and keywords."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from furcl.errors import SceneError
from furcl.scene.document import MAX_DEPTH, parse_toml
from furcl.scene.schema import files_in, is_text, type_at
from furcl.scene.tables import Keys, kinds_at
from furcl.values import is_number, is_whole, shown

Document = dict[str, Any]

_KEYWORDS = {
    "spp": "render.spp",
    "seed": "render.seed",
    "sampling": "render.sampling",
    "max_depth": "render.max_depth",
    "camera": "film.camera",
}


def keyword_overrides(keywords: dict[str, Any]) -> list[str]:
    """Overrides for the keywords of `furcl.load_scene`; those that are None change nothing.

    Raises
    ------
    TypeError       another keyword
    SceneError      a size that is none
    """
    changes = []
    for name, value in keywords.items():
        if name != "size" and name not in _KEYWORDS:
            raise TypeError(f"unknown keyword {name!r}; allowed are size, {', '.join(_KEYWORDS)}")
        if value is None:
            continue
        if name != "size":
            if not (is_number(value) or isinstance(value, str)):
                raise SceneError(f"{name} = {shown(value)}: expected a number or a word")
            try:
                changes.append(f"{_KEYWORDS[name]}={value}")
            except ValueError:  # a whole number of thousands of digits
                raise SceneError(f"{name} = {shown(value)}: out of its range") from None
            continue
        size = value.lower().split("x") if isinstance(value, str) else value
        if not _is_size(size):
            raise SceneError(f"size = {shown(value)}: expected WxH in pixels, for example 640x480")
        changes += [f"film.width={size[0]}", f"film.height={size[1]}"]
    return changes


def _is_size(size: Any) -> bool:
    """Whether these are two numbers of pixels, as numbers or digits."""
    if not isinstance(size, list | tuple) or len(size) != 2:
        return False
    return all(n.strip().isdecimal() if isinstance(n, str) else is_whole(n) for n in size)


def apply_overrides(document: Document, overrides: Iterable[str]) -> Document:
    """A copy of a scene document with values replaced.

    An override that changes the kind of a table (`environment.kind`, `curves.generator`,
    `fibre.model`) takes the table's other keys away, since they belong to the former kind; those
    that overrides of the same call give are kept, whether they stand before or after it.

    Parameters
    ----------
    document : dict             tables as `tomllib` gives them
    overrides : list of str     "dotted.key=VALUE". Where text is expected VALUE is that text, with
                                quotes or without; elsewhere it is a TOML value. Relative files are
                                sought in the current directory.

    Raises
    ------
    SceneError      if one has no "=", or goes through a value that is no table
    """
    changes = [_split(override) for override in overrides]
    document = copy.deepcopy(document)
    for keys, (kind, override) in {k: (_text(text), o) for k, text, o in changes}.items():
        kinds = kinds_at(keys[:-1])
        if kinds and keys[-1] == kinds.tag:
            outer = _table_for(document, keys[:-1], override)
            if kinds.name_in(outer.get(keys[-2], {})) != kind:
                outer[keys[-2]] = {kinds.tag: kind}
    for keys, text, override in changes:
        hint = type_at(document, keys)
        value = {keys[-1]: _text(text) if is_text(hint) else _toml_value(text)}
        absolute_files(value, Path())
        _table_for(document, keys, override).update(value)
    return document


def absolute_files(document: Document, folder: Path) -> None:
    """Make the names of files in a document absolute; they are relative to a folder."""
    for keys, table in files_in(document):
        table[keys[-1]] = str((folder / table[keys[-1]]).absolute())


def _split(override: str) -> tuple[Keys, str, str]:
    """Keys and value of an override, and the override for messages."""
    dotted, equals, text = override.partition("=")
    keys = tuple(key.strip() for key in dotted.split("."))
    if not equals or not all(keys) or len(keys) > MAX_DEPTH:
        raise SceneError(
            f"override {shown(override)}: expected KEY=VALUE with a dotted key, "
            f"for example render.spp=16 or curves.file=groom.hair"
        )
    return keys, text, override


def _table_for(document: Document, keys: Keys, override: str) -> Document:
    """The table that is to hold the last key; those on the way are made where they are missing."""
    table = document
    for depth, key in enumerate(keys[:-1], 1):
        if table.get(key) is None:
            table[key] = {}
        table = table[key]
        if not isinstance(table, dict):
            raise SceneError(
                f"override {shown(override)}: {'.'.join(keys[:depth])} is a value, not a table; "
                f"set it without a further key"
            )
    return table


def _text(text: str) -> str:
    """What an override gives where text is expected: quotes may be there or not."""
    value = _toml_value(text)
    return value if isinstance(value, str) else text


def _toml_value(text: str) -> Any:
    """A TOML value; text that is none is a string."""
    try:
        parsed = parse_toml(f"value = {text}")
    except ValueError:
        return text
    return parsed["value"] if len(parsed) == 1 else text
