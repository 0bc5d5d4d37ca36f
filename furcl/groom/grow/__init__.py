"""Procedural grooms: hair on a scalp, fur, straight fibres; the same seed, the same strands."""

from collections.abc import Mapping
from types import FunctionType
from typing import Any

from furcl.groom.grow.animal_fur import fur
from furcl.groom.grow.ranges import FIBRE_RANGES, FUR_RANGES, HAIR_RANGES
from furcl.groom.grow.scalp_hair import hair
from furcl.groom.grow.straight_fibre import fibre

GENERATORS: dict[str, FunctionType] = {"hair": hair, "fur": fur, "fibre": fibre}
RANGES = {"hair": HAIR_RANGES, "fur": FUR_RANGES, "fibre": FIBRE_RANGES}

BODY_SHRINK = 0.995

__all__ = [
    "GENERATORS",
    "RANGES",
    "body_of",
    "fibre",
    "fur",
    "hair",
]


def body_of(
    generator: str, parameters: Mapping[str, Any]
) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Centre and radii of an ellipsoid that fills the scalp or the sphere, or None without one.

    It is 0.5 % smaller than the surface on which the strands begin.
    """
    values = {**(GENERATORS[generator].__kwdefaults__ or {}), **parameters}
    if generator == "hair":
        centre, radii = values["scalp_centre"], values["scalp_radii"]
    elif generator == "fur" and values["surface"] == "sphere":
        centre, radii = values["centre"], (values["sphere_radius"],) * 3
    else:
        return None
    return tuple(centre), tuple(BODY_SHRINK * r for r in radii)
