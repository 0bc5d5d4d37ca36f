"""What of lamps crosses to the device: the words of their records, of their tree and of its header.

Every word is a float, or a uint of the same bits where the comment says so.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from furcl.device.layout import Fields, hex_float

Words = tuple[tuple[str, int], ...]

#: Kinds in the order of their numbers: rays meet the first three, and instead of a triangle the
#: mesh that it is of; the next two have no extent, and the last is at infinity.
KINDS = ("quad", "disk", "sphere", "triangle", "point", "spot", "distant")
MET_KINDS = KINDS[:3]
AREA_KINDS = KINDS[:4]
PLACED_KINDS = KINDS[:6]

LAMP: Words = (
    ("CENTRE", 3),  # or the corner of a triangle
    ("KIND", 1),  # uint
    ("A", 3),  # half axes of flat lamps, edges of a triangle
    ("TWO_SIDED", 1),  # 1: both sides of a flat lamp shine
    ("B", 3),
    ("EXTENT", 1),  # area of flat lamps, radius, 1 - cos of a distant lamp's angular radius
    ("A_DUAL", 3),  # A_DUAL . A = 1, A_DUAL . B = 0, in the plane of the lamp
    ("COS_INNER", 1),  # of a spot: up to here its light is whole ...
    ("B_DUAL", 3),
    ("COS_OUTER", 1),  # ... and from here on there is none
    ("RADIANCE", 3),  # or intensity, or irradiance, see the kinds
    ("TRAIL", 1),  # uint: bit k is 1 if at level k of the tree it is in the second half
    ("AXIS", 3),  # unit: the way in which most of its light goes
    ("UNUSED", 1),
)
NODE: Words = (
    ("LOWER", 3),
    ("INTENSITY", 1),  # largest of its lamps, luminance, summed
    ("UPPER", 3),
    ("COS_AXIS", 1),  # the axes of its lamps are within this of AXIS; -1: they shine everywhere
    ("AXIS", 3),  # unit
    ("COS_EDGE", 1),  # the light of its lamps ends so far from their axes
    ("NEXT", 1),  # uint: node behind all that is in it
    ("LAMP", 1),  # uint, or FURCL_NO_LAMP
)
HEADER: Words = (
    ("ENVIRONMENT", 1),  # uint: first word of the environment's buffer
    ("N_LAMPS", 1),  # uint
    ("N_PLACED", 1),  # uint: the first of them have a place ...
    ("N_WIDE", 1),  # uint: ... and the next have none, but an angle
    ("NODES", 1),  # uint: first word
    ("N_NODES", 1),  # uint
    ("INFINITE_CDF", 1),  # uint: first word
    ("N_INFINITE", 1),  # uint: entries: the environment, if there is one, and lamps without a place
    ("FLUENCE", 1),  # of these: luminance of radiance over all directions
    ("WORDS", 1),  # uint: of the whole buffer
)

#: Light samples take no less often than this what comes from infinity, and what has a place.
LEAST_CHANCE = 0.1

#: Shadow rays end so far before a triangle, of its size and distance: they must not meet the mesh
#: that it is of.
TRIANGLE_MARGIN = 1e-6

# Hits keep the number of a lamp as a float.
MOST_LAMPS = 1 << 24


def size_of(words: Words) -> int:
    """Words of a record."""
    return sum(width for _, width in words)


def offsets(words: Words) -> dict[str, int]:
    """Field -> its first word."""
    places, at = {}, 0
    for name, width in words:
        places[name] = at
        at += width
    return places


@dataclass(frozen=True)
class LampsPart:
    """What kernels are built from where a scene has lamps: the part <lamps> of their features.

    Attributes
    ----------
    kinds : tuple of str    of KINDS, in their order
    by_position : bool      lamps are chosen by the light that they may send to a point, not by
                            their power alone
    """

    kinds: tuple[str, ...]
    by_position: bool = True

    name = "lamps"
    header = Path("light/lamps/lamps.clh")

    @property
    def area(self) -> bool:
        """Whether rays can meet some of them, beside meshes."""
        return any(kind in MET_KINDS for kind in self.kinds)

    @property
    def placed(self) -> bool:
        """Whether some have a place, so that shadow rays end at a distance."""
        return any(kind in PLACED_KINDS for kind in self.kinds)

    def everything_on(self) -> LampsPart:
        """The same with all kinds."""
        return LampsPart(KINDS, self.by_position)

    def defines(self) -> dict[str, int | str]:
        """Kinds there are and their numbers, places in records and the header."""
        values: dict[str, int | str] = {
            "FURCL_LAMPS": 1,
            "FURCL_AREA_LAMPS": int(self.area),
            "FURCL_LAMPS_BY_POSITION": int(self.by_position),
        }
        for number, kind in enumerate(KINDS):
            values[f"FURCL_LAMP_{kind.upper()}"] = int(kind in self.kinds)
            values[f"LAMP_IS_{kind.upper()}"] = f"{number}u"
        for prefix, words in (("LAMP", LAMP), ("NODE", NODE), ("LIGHTS", HEADER)):
            values |= {f"{prefix}_{name}": f"{at}u" for name, at in offsets(words).items()}
            values[f"{prefix}_SIZE"] = f"{size_of(words)}u"
        values["LIGHTS_LEAST_CHANCE"] = hex_float(LEAST_CHANCE)
        values["TRIANGLE_MARGIN"] = hex_float(TRIANGLE_MARGIN)
        return values

    def structs(self) -> dict[str, Fields]:
        """None: the buffer holds words only."""
        return {}

    def as_dict(self) -> dict[str, Any]:
        """Kinds and choice."""
        return {
            "lamp_kinds": list(self.kinds),
            "lamp_choice": "position" if self.by_position else "power",
        }
