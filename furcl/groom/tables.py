"""The tables of the groom generators, made from signatures and ranges of `furcl.groom.grow`."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta

from furcl.groom import grow

if TYPE_CHECKING:
    from furcl.groom.curves import Curves


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
    parameters = inspect.signature(grow.GENERATORS[generator]).parameters
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


if TYPE_CHECKING:

    class HairCurves(msgspec.Struct, frozen=True):
        """Hair on an ellipsoidal scalp."""

    class FurCurves(msgspec.Struct, frozen=True):
        """Fur on a sphere or a patch."""

    class FibreCurves(msgspec.Struct, frozen=True):
        """Parallel straight fibres."""

else:
    HairCurves = _table("hair", grow.HAIR_RANGES)
    FurCurves = _table("fur", grow.FUR_RANGES)
    FibreCurves = _table("fibre", grow.FIBRE_RANGES)


def build_generated(table: msgspec.Struct) -> Curves:
    """Grow the groom that a table describes.

    Raises
    ------
    GroomError      if the generator refuses its parameters
    """
    generator = grow.GENERATORS[str(table.__struct_config__.tag)]
    return generator(**{name: getattr(table, name) for name in table.__struct_fields__})
