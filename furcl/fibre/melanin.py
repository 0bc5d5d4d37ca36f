"""The table of pigments in a scene's fibre."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from furcl.table import Table


class Melanin(Table, frozen=True, kw_only=True):
    """Concentrations of the pigments of hair.

    Attributes
    ----------
    eumelanin : float       the brown and black one; 0.3 is blond, 1.3 brown, 8 black
    pheomelanin : float     the red and yellow one
    """

    eumelanin: Annotated[float, Meta(ge=0.0, le=100.0, examples=[1.3])] = 0.0
    pheomelanin: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
