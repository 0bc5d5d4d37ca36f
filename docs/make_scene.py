"""Writes docs/scene.md, the reference of scene files: python docs/make_scene.py.

Types, ranges and defaults are those of the tables that read scenes; meanings and units stand in the
sections "Attributes" or "Parameters" of their docstrings (furcl/table.py). Every table has an
example in docs/scene_examples.
"""

from __future__ import annotations

import inspect
import re
import types
import typing
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union

import msgspec
from msgspec import NODEFAULT, Meta

from furcl.scene.meanings import Limits, meanings
from furcl.scene.schema import named_tables
from furcl.scene.tables import NAMED, Scene, kinds_at
from furcl.table import Table

PAGE = Path(__file__).with_name("scene.md")
EXAMPLES = Path(__file__).with_name("scene_examples")
INTRODUCTION = """# Scene files

*Written by `make docs` from the tables that read scenes.*

A scene is a TOML file of the tables below. `fibre`, `environment` and `curves` must be there, all
else has defaults:

```toml
[fibre]
preset = "human-black"

[environment]
kind = "constant"

[curves]
generator = "fur"
```

Unknown keys and values outside their ranges are refused by name. File names are sought beside the
scene file. `furcl render SCENE --set fibre.kappa=0.5 --set environment.kind=sky` replaces values,
or adds what is not there; files named so are sought where you are. In Python it is
`furcl.load_scene(path, overrides=["fibre.kappa=0.5"])`.

A scene of several grooms has a table for each, `[groom.NAME]` with `[groom.NAME.curves]`, instead
of `[curves]`, which is the short form of one. Its fibre is `[groom.NAME.fibre]`, a material that it
names, `[material.NAME]` with the keys of `[fibre]`, or the scene's `[fibre]`. A list, `[[groom]]`
with a key `name`, is read as well.

Several cameras are a list, `[[camera]]` with a key `name`, or tables `[cameras.NAME]`;
`film.camera`, `--camera NAME` on the command line, says which one sees the picture.

Where a key says of which kind its table is (`fibre.model`, `environment.kind`, `curves.generator`),
changing the kind takes the table's other keys away, since they belong to the former kind; those
that the same command gives, before it or after it, are kept. Text needs no quotes there.

Lengths are in the scene's unit of length, "unit" below; z is up. Angles are degrees (suffix
`_deg`), absorption and scattering of fibres per fibre radius, radiance and colours linear with
Rec.709 primaries. A dash is nothing, or what the last column says.
"""


@dataclass(frozen=True)
class Section:
    """A table of the page: its name in the scene, what tells its kind, and its type."""

    name: str
    struct: type[Table]
    tag: str = ""
    kind: str = ""
    default: bool = False
    of_list: bool = False

    @property
    def heading(self) -> str:
        """As a scene has it."""
        if self.of_list:
            return f"[[{self.name}]]"
        return f"[{self.name}] {self.tag} = {self.kind}" if self.kind else f"[{self.name}]"

    @property
    def example(self) -> str:
        """A piece of a scene with this table."""
        name = f"{self.name}-{self.kind}" if self.kind else self.name
        return (EXAMPLES / f"{name.replace('.', '-')}.toml").read_text()


@dataclass(frozen=True)
class Key:
    """A row of the page; `limits` are the lowest and highest value, where there are such."""

    name: str
    kind: str
    unit: str
    range: str
    default: str
    meaning: str
    limits: Limits | None


def sections() -> list[Section]:
    """Every table that a scene may hold, in the order of the scene."""
    found = []
    for field in msgspec.structs.fields(Scene):
        kinds = kinds_at((field.name,))
        named = named_tables(field.type)
        if kinds:
            outer = [
                Section(field.name, struct, kinds.tag, kind, kind == kinds.default)
                for kind, struct in kinds.tables().items()
            ]
        elif named and NAMED[field.name] == field.name:
            kinds = kinds_at((field.name, "NAME"))
            outer = [
                Section(f"{field.name}.NAME", struct, kinds.tag, kind)
                for kind, struct in (kinds.tables() if kinds else {}).items()
            ]
        elif named:
            outer = [] if NAMED[field.name] else [Section(f"{field.name}.NAME", named)]
        else:
            outer = [Section(field.name, t) for t in _tables_in(field.type)]
        for section in outer:
            inner = msgspec.structs.fields(section.struct)
            found += [section]
            tables = [
                Section(f"{section.name}.{f.name}", t)
                for f in inner
                if not (named and kinds_at((*section.name.split("."), f.name)))
                for t in _tables_in(f.type)
            ]
            tables += [
                Section(f"{section.name}.{f.name}", t, of_list=True)
                for f in inner
                for t in _listed_in(f.type)
            ]
            found += [table for table in tables if table not in found]
    return found


def keys(struct: type[Table]) -> list[Key]:
    """All keys of a table, that which tells its kind left out.

    Raises
    ------
    ValueError      if a key has no meaning, or its docstring states another range than holds
    """
    described = struct.described_by
    told = {**meanings(described.__doc__ if described else None), **meanings(struct.__doc__)}
    found = []
    for field in msgspec.structs.fields(struct):
        if field.name not in told:
            raise ValueError(
                f"{struct.__name__}.{field.name} has no meaning; add a line for it to the section "
                f"Attributes of the table's docstring"
            )
        text, unit, stated = (meaning := told[field.name]).text, meaning.unit, meaning.limits
        words, limits = _range(field.type, struct.allowed.get(field.name, ()))
        if stated and not (limits and _agree(stated, limits)):
            raise ValueError(
                f"{struct.__name__}.{field.name}: its docstring states the range {stated}, its "
                f"type {limits}; correct one of them"
            )
        kind, default = _kind(field.type), _default(field, described)
        found.append(Key(field.name, kind, unit, words, default, text, limits))
    return found


def _agree(a: Limits, b: Limits) -> bool:
    """Equal up to the digits that docstrings print."""
    return all(abs(x - y) <= 1e-3 * max(abs(x), abs(y)) for x, y in zip(a, b, strict=True))


def _parts(hint: Any) -> list[Any]:
    """The types that a type allows, without None."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (Union, types.UnionType):
        return [p for allowed in arguments for p in _parts(allowed) if p is not types.NoneType]
    if origin is Annotated and typing.get_origin(arguments[0]) in (Union, types.UnionType):
        return _parts(arguments[0])
    return [hint]


def _bare(hint: Any) -> Any:
    """A type without what restricts its values."""
    return typing.get_args(hint)[0] if typing.get_origin(hint) is Annotated else hint


def _tables_in(hint: Any) -> list[type[Table]]:
    return [p for p in _parts(hint) if isinstance(p, type) and issubclass(p, Table)]


def _listed_in(hint: Any) -> list[type[Table]]:
    """The tables of which a list is made."""
    lists = [p for p in _parts(hint) if Ellipsis in typing.get_args(p)]
    return [t for found in lists for t in _tables_in(typing.get_args(found)[0])]


def _kind(hint: Any) -> str:
    """The type of a value in words."""
    names = {bool: "true or false", int: "whole number", float: "number", str: "text"}
    words = []
    for part in map(_bare, _parts(hint)):
        if typing.get_origin(part) is tuple:
            inner = typing.get_args(part)
            if inner[-1] is Ellipsis:
                words.append(f"list of {_kind(inner[0])}s".replace("texts", "words"))
                continue
            if typing.get_origin(inner[0]) is tuple:
                words.append(f"{len(inner)} rows of {_kind(inner[0])}")
                continue
            words.append(f"{len(inner)} {names[_bare(inner[0])]}s")
        else:
            words.append("text" if typing.get_origin(part) is Literal else names.get(part, "table"))
    return " or ".join(words)


def _range(hint: Any, allowed: tuple[Any, ...]) -> tuple[str, Limits | None]:
    """What values are allowed, in words and as limits; `allowed` where the type does not say."""
    each = [typing.get_args(p)[0] if Ellipsis in typing.get_args(p) else p for p in _parts(hint)]
    choices = [w for p in each if typing.get_origin(p) is Literal for w in typing.get_args(p)]
    choices = choices or [word for word in allowed if isinstance(word, str)]
    if choices:
        return ", ".join(f"`{word}`" for word in choices), None
    if allowed:
        return f"{_value(allowed[0])} to {_value(allowed[1])}", (allowed[0], allowed[1])
    for part in _parts(hint):
        each = typing.get_args(part)[0] if typing.get_origin(part) is tuple else part
        for meta in each.__metadata__ if typing.get_origin(each) is Annotated else ():
            if isinstance(meta, Meta) and meta.le is not None:
                above, low = (True, meta.gt) if meta.gt is not None else (False, meta.ge)
                words = f"{'above ' if above else ''}{_value(low)} to {_value(meta.le)}"
                return words, (float(low or 0), float(meta.le))
    return "", None


def _default(field: msgspec.structs.FieldInfo, described: type | None) -> str:
    """The value of a key that is left out."""
    default = field.default
    if default is None and described is not None and is_dataclass(described):
        default = {f.name: f.default for f in fields(described)}.get(field.name)
    if field.required:
        return "must be given"
    if default is NODEFAULT:
        return "-"
    return "-" if default in (None, "") or isinstance(default, Table) else f"`{_value(default)}`"


def _value(value: Any) -> str:
    """As TOML has it, numbers short."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, int):
        return f"2^{value.bit_length()} - 1" if value in (2**32 - 1, 2**63 - 1) else str(value)
    return re.sub(r"e\+?(-?)0?", r"e\1", f"{value:.5g}")


def page() -> str:
    """The text of docs/scene.md."""
    outside = [key for key in keys(Scene) if key.kind != "table"]
    parts = [INTRODUCTION, f"## Outside of the tables\n\n{_rows(outside)}"]
    for section in sections():
        text = inspect.cleandoc(section.struct.__doc__ or "")
        prose = re.split(r"\n\n\w+\n-+\n", text)[0]
        rows = _rows(keys(section.struct))
        if section.default:
            prose += f"\n`{section.tag}` may be left out."
        parts.append(f"## {section.heading}\n\n{prose}\n\n{rows}\n```toml\n{section.example}```\n")
    return "\n".join(parts)


def _rows(rows: list[Key]) -> str:
    head = "| key | type | unit | range | default | meaning |\n|---|---|---|---|---|---|\n"
    cells = [(f"`{k.name}`", k.kind, k.unit, k.range, k.default, k.meaning) for k in rows]
    return head + "".join(f"| {' | '.join(row)} |\n" for row in cells)


if __name__ == "__main__":
    PAGE.write_text(page())
