"""d'Eon et al. 2011 as a fibre model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from furcl.fibre.cylinder.model import RESIDUAL, CylinderFeatures, CylinderModel, lobes_of
from furcl.fibre.cylinder.presets import PIGMENTS
from furcl.fibre.cylinder.table import CylinderTable
from furcl.fibre.deon.parameters import ORDERS, RANGES, DEonFibre
from furcl.fibre.pigment import COLOUR_RANGE, sigma_ca_from_colour, sigma_ca_from_colours
from furcl.fibre.ranges import Triple


class DEonTable(CylinderTable, frozen=True, kw_only=True, tag="deon"):
    """A fibre of d'Eon et al. 2011: human hair by pigment, or parameters of one's own; the colour
    in one of three ways.

    Attributes
    ----------
    preset : str            absorption by name
    colour : (r,g,b)        wanted colour of a thick groom, from which sigma_a follows
    melanin : table         pigments, from which sigma_a follows
    absorption : table      sigma_a where it differs between strands or along them
    mode : str              as of the double cylinder: "far", "near", "multiscale"
    """

    described_by: ClassVar = DEonFibre
    allowed: ClassVar = {**RANGES, "preset": tuple(PIGMENTS), "colour": COLOUR_RANGE}

    beta_m_deg: float | None = None
    beta_n_deg: float | None = None
    orders: Annotated[int, Meta(ge=ORDERS[0], le=ORDERS[1])] = 3
    cone: bool = False

    def sigma_of(self, colour: Triple, fibre: DEonFibre) -> Triple:
        return sigma_ca_from_colour(colour, fibre.beta_n_deg)


class DEon(CylinderModel):
    """docs/models/deon.md."""

    name = "deon"
    lobes = lobes_of(ORDERS[1])
    header = Path("fibre/deon/bcsdf.clh")
    reference = "furcl.fibre.deon.reference"

    @property
    def table(self) -> type[DEonTable]:
        return DEonTable

    def features(self, fibre: DEonFibre, *, residual: bool = False) -> CylinderFeatures:
        return CylinderFeatures(
            "deon",
            orders=fibre.orders,
            tilt=fibre.tilt != 0.0,
            cone=fibre.cone,
            dropped_lobes=() if residual else (RESIDUAL,),
        )

    def absorption_of_colour(self, fibre: DEonFibre, colour: np.ndarray) -> np.ndarray:
        return sigma_ca_from_colours(colour, fibre.beta_n_deg)

    def params(self, fibre: DEonFibre) -> np.ndarray:
        params = super().params(fibre)
        params["beta_m"] = fibre.beta_m
        params["beta_n"] = fibre.beta_n
        return params


MODEL = DEon()
