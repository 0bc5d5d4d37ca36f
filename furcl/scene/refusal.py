"""What is wrong with a scene document, in words: which key, what was found, what is allowed."""

from __future__ import annotations

import difflib
import re
from typing import Any, NoReturn

import msgspec

from furcl.errors import SceneError
from furcl.scene.schema import (
    allows_none,
    choices,
    example,
    fields,
    named_tables,
    table_type,
    type_at,
)
from furcl.scene.tables import Keys, Kinds, Scene, kinds_at
from furcl.values import LONGEST_SHOWN, shown

MOST_IN_NAME = 64
NAME = re.compile(rf"[\w-]{{1,{MOST_IN_NAME}}}")


def check_tables(document: object, source: str) -> None:
    """Refuse what is no table where one is expected, unknown kinds and unknown keys.

    Raises
    ------
    SceneError      names the key, and the nearest known one
    """
    _check_keys(document, Scene, (), source)


def _check_keys(table: Any, struct: type[msgspec.Struct], at: Keys, source: str) -> None:
    types = fields(struct)
    for key, value in table.items():
        if key not in types:
            _refuse_key(key, struct, at, source)
        _check_value(value, types[key], (*at, key), source)


def _check_value(value: Any, hint: Any, at: Keys, source: str) -> None:
    kinds, where = kinds_at(at), ".".join(at)
    inner = table_type(kinds, hint, value)
    named = named_tables(hint)
    if isinstance(value, dict) and named:
        for name, each in value.items():
            if not NAME.fullmatch(name):
                raise SceneError(
                    f"{source}: {where}.{_cut(name)}: a name has letters, digits, _ and -, at most "
                    f"{MOST_IN_NAME}"
                )
            _check_value(each, named, (*at, name), source)
    elif isinstance(value, dict) and inner:
        _check_keys(value, inner, at, source)
    elif isinstance(value, dict) and kinds:
        _refuse_kind(where, kinds, value, source)
    elif (inner or kinds or named) and not (value is None and allows_none(hint)):
        example = _example(f"{where}.NAME" if named else where, kinds, inner)
        keys = _keys_of(kinds, inner) or "its keys are names"
        raise SceneError(
            f"{source}: {where} = {shown(value)}: expected a table, for example {example}; {keys}"
        )


def _keys_of(kinds: Kinds | None, struct: type[msgspec.Struct] | None) -> str:
    """The keys that a table may have, or the key that says which."""
    struct = kinds.type_of({}) if kinds else struct
    if struct is None:
        return f"{kinds.tag} is one of {', '.join(kinds.tables())}" if kinds else ""
    return f"its keys are {', '.join(fields(struct))}"


def _refuse_key(key: str, struct: type[msgspec.Struct], at: Keys, source: str) -> NoReturn:
    where = "".join(f"{outer}." for outer in at)
    known, config = fields(struct), struct.__struct_config__
    kind = f" with {config.tag_field} = {config.tag!r}" if config.tag_field else ""
    near = difflib.get_close_matches(key, known, 1, 0.6)
    kinds = kinds_at(at)
    others = kinds.tables().items() if kinds else ()
    owners = [repr(name) for name, table in others if key in fields(table)]
    if owners:
        remedy = f"; {config.tag_field} = {' or '.join(owners)} has it."
    else:
        remedy = f"; did you mean {where}{near[0]}?" if near else "."
    raise SceneError(
        f"{source}: unknown key {where}{_cut(key)}{kind}{remedy} Known are {', '.join(known)}."
    )


def _cut(key: str) -> str:
    """A key as it is, or as much of a very long one as one can read."""
    return key if len(key) <= LONGEST_SHOWN else shown(key)


def _refuse_kind(name: str, kinds: Kinds, table: Any, source: str) -> NoReturn:
    if kinds.tag not in table:
        refuse_missing(f"{name}.{kinds.tag}", source)
    found = table[kinds.tag]
    raise SceneError(
        f"{source}: {name}.{kinds.tag} = {shown(found)}: {_allowed(found, tuple(kinds.tables()))}"
    )


def _example(where: str, kinds: Kinds | None, struct: type[msgspec.Struct] | None) -> str:
    """A key of a table with a value."""
    if kinds and kinds.default is None:
        return f"{where}.{kinds.tag}={next(iter(kinds.tables()))}"
    struct = kinds.type_of({}) if kinds else struct
    return where if struct is None else f"{where}.{example(struct)}"


def refuse_missing(where: str, source: str) -> NoReturn:
    """Refuse a document in which a key is missing."""
    raise SceneError(
        f"{source}: {where} is missing; add it to the file or give --set {where}=VALUE"
    )


def refuse_value(message: str, document: dict[str, Any], at: Keys, source: str) -> NoReturn:
    """Refuse a value of the table or value that keys lead to, by what msgspec says of it.

    Its message ends with the path inside that table.
    """
    what, _, path = message.partition(" - at `$")
    keys, where = list(at), ".".join(at)
    value: Any = document
    for key in at:
        value = value[key]
    for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", path):
        where += f"[{index}]" if index else f".{key}"
        if index:
            value = value[int(index)]
        else:
            keys.append(key)
            value = value.get(key) if isinstance(value, dict) else None
    missing = re.search(r"missing required field `(\w+)`", what)
    if missing:
        refuse_missing(f"{where}.{missing[1]}", source)
    if re.match(r"\w+ = ", what):  # a table's own check, which names its key
        raise SceneError(f"{source}: {where}.{what}")
    words = choices(type_at(document, tuple(keys)))
    if words and not what.startswith("Expected `array`"):
        what = _allowed(value, words)
    elif what.startswith("Expected"):
        what = "e" + what[1:].replace("`object`", "a table")
    found = "" if isinstance(value, dict) else f" = {shown(value)}"
    raise SceneError(f"{source}: {where}{found}: {what}")


def _allowed(found: Any, words: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(shown(found).strip("'"), words, 1, 0.5)
    return f"allowed are {', '.join(words)}" + (f"; did you mean {near[0]!r}?" if near else "")
