"""What the tables of scene files are made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import msgspec
from msgspec import Meta

Triple = tuple[float, float, float]
Coordinate = Annotated[float, Meta(ge=-1e9, le=1e9)]
Vec3 = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[float, Meta(gt=0.0, le=1e9)]
# One number or three. The ranges are checked in __post_init__: msgspec (up to 0.22) crashes in the
# garbage collector on unions of a constrained number and a tuple of constrained numbers.
Rgb = float | tuple[float, float, float]


def triple(value: float | Triple) -> Triple:
    """One number as three equal ones; three as they are."""
    return value if isinstance(value, tuple) else (value, value, value)


def check_range(name: str, value: Rgb, low: float, high: float) -> None:
    """ValueError unless one number or all three are in low..high."""
    if not all(low <= number <= high for number in triple(value)):
        raise ValueError(
            f"{name} = {value}: allowed is {low:g} to {high:g}, as one number or three"
        )


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of the tables of a scene.

    The section Attributes of a table's docstring has a line for every key, "name : type   meaning
    [unit]"; docs/scene.md is written from it. Ranges are in the types, what those cannot say is in
    `allowed`: (lowest, highest) of a key that takes one number or three, or words. Such numbers are
    checked here, unless a table has checks of its own. Keys that the docstring leaves out are those
    of the class `described_by`, whose docstring and defaults hold for them.
    """

    allowed: ClassVar[Mapping[str, tuple[Any, ...]]] = {}
    described_by: ClassVar[type | None] = None

    def __post_init__(self) -> None:
        for name, (low, high) in self.allowed.items():
            check_range(name, getattr(self, name), low, high)
