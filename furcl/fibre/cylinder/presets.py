"""Presets of cylinders without a medulla: human hair by pigment."""

from __future__ import annotations

import difflib

from furcl.errors import FibreError
from furcl.fibre.pigment import sigma_ca_from_melanin
from furcl.fibre.ranges import Triple

# Eumelanin and pheomelanin; blond, brown and black are those that Chiang's coefficients are quoted
# with, white is without absorption, red chosen here.
PIGMENTS = {
    "black": (8.0, 0.0),
    "brown": (1.3, 0.2),
    "blond": (0.3, 0.1),
    "red": (0.25, 1.2),
    "white": (0.0, 0.0),
}


def absorption(preset: str) -> Triple:
    """(r, g, b) of a preset per fibre radius.

    Raises
    ------
    FibreError      unknown name (the nearest one is given)
    """
    if preset not in PIGMENTS:
        near = difflib.get_close_matches(preset.lower(), PIGMENTS, 1, 0.0)
        raise FibreError(
            f"fibre.preset = {preset!r} is not known - did you mean {near[0]!r}? - allowed are "
            f"{', '.join(PIGMENTS)}"
        )
    return sigma_ca_from_melanin(*PIGMENTS[preset])
