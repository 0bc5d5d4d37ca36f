"""The tables of the groom generators, made from `furcl.procedural`: its signatures and its ranges."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta

from furcl import procedural

if TYPE_CHECKING:
    from furcl.curves import Curves


def _field_type(allowed: tuple[Any, ...], default: Any) -> Any:
    """The type of a parameter: a choice of words, or whole or real numbers within a range."""
    if isinstance(allowed[0], str):
        kind: Any = Literal[*allowed]
    else:
        number = int if isinstance(allowed[0], int) else float
        kind = Annotated[number, Meta(ge=allowed[0], le=allowed[1])]
    if isinstance(default, tuple):
        kind = tuple[*[kind] * len(default)]
    return kind | None if default is None else kind


def _table(generator: str, ranges: dict[str, tuple[Any, ...]]) -> Any:
    parameters = inspect.signature(procedural.GENERATORS[generator]).parameters
    fields = [
        (name, _field_type(ranges[name], parameter.default), parameter.default)
        for name, parameter in parameters.items()
    ]
    return msgspec.defstruct(
        f"{generator.capitalize()}Curves",
        fields,
        frozen=True,
        kw_only=True,
        forbid_unknown_fields=True,
        tag_field="generator",
        tag=generator,
        module=__name__,
    )


HairCurves: Any = _table("hair", procedural.HAIR_RANGES)
FurCurves: Any = _table("fur", procedural.FUR_RANGES)
FibreCurves: Any = _table("fibre", procedural.FIBRE_RANGES)


def build_generated(table: msgspec.Struct) -> Curves:
    """Grow the groom that a table describes.

    Raises
    ------
    GroomError      if the generator refuses its parameters
    """
    grow = procedural.GENERATORS[str(table.__struct_config__.tag)]
    return grow(**{name: getattr(table, name) for name in table.__struct_fields__})
