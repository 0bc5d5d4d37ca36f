"""Checks of a fibre's parameters against their ranges."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from numbers import Real
from typing import cast

from furcl.errors import FibreError

Range = tuple[float, float]
Triple = tuple[float, float, float]


def check_parameters(
    fibre: object,
    ranges: Mapping[str, Range],
    triples: Collection[str],
    units: Mapping[str, str] | None = None,
) -> None:
    """Put the parameters of a frozen dataclass in order: numbers as floats, triples as tuples.

    Raises
    ------
    FibreError      as `number`
    """
    for name, allowed in ranges.items():
        check = triple if name in triples else number
        value = check(name, getattr(fibre, name), allowed, (units or {}).get(name, ""))
        object.__setattr__(fibre, name, value)


def number(name: str, value: object, allowed: Range, unit: str = "") -> float:
    """A number within its range.

    Raises
    ------
    FibreError      names the parameter, its value and the allowed range
    """
    low, high = allowed
    if isinstance(value, bool) or not isinstance(value, Real) or not low <= float(value) <= high:
        raise FibreError(
            f"fibre.{name} = {value!r} - allowed is a number from {low:g} to {high:g}{unit}"
        )
    return float(value)


def triple(name: str, value: object, allowed: Range, unit: str = "") -> Triple:
    """Three numbers within a range; one stands for three equal ones.

    Raises
    ------
    FibreError      as `number`
    """
    if isinstance(value, Real):
        only = number(name, value, allowed, unit)
        return (only, only, only)
    low, high = allowed
    try:
        items = list(cast(Sequence[object], value))
    except TypeError:
        items = []
    if isinstance(value, str) or len(items) != 3:
        raise FibreError(
            f"fibre.{name} = {value!r} - allowed is one number or three (r, g, b) "
            f"from {low:g} to {high:g}{unit}"
        )
    r, g, b = (number(name, item, allowed, unit) for item in items)
    return (r, g, b)
