"""Chiang et al. 2016 as a fibre model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import ClassVar

import numpy as np

from furcl.fibre.chiang.parameters import RANGES, ChiangFibre, sigma_a_from_colour
from furcl.fibre.cylinder.model import CylinderFeatures, CylinderModel, lobes_of
from furcl.fibre.cylinder.presets import PIGMENTS
from furcl.fibre.cylinder.table import CylinderTable
from furcl.fibre.pigment import COLOUR_RANGE, albedo_polynomial
from furcl.fibre.ranges import Triple


class ChiangTable(CylinderTable, frozen=True, kw_only=True, tag="chiang"):
    """A fibre of Chiang et al. 2016: human hair by pigment, or parameters of one's own; the colour
    in one of three ways.

    Attributes
    ----------
    preset : str            absorption by name, with the model's usual roughnesses
    colour : (r,g,b)        wanted colour of a thick groom, from which sigma_a follows
    melanin : table         pigments, from which sigma_a follows
    absorption : table      sigma_a where it differs between strands or along them
    mode : str              as of the double cylinder: "far", "near", "multiscale"
    """

    described_by: ClassVar = ChiangFibre
    allowed: ClassVar = {**RANGES, "preset": tuple(PIGMENTS), "colour": COLOUR_RANGE}

    beta_m: float | None = None
    beta_n: float | None = None

    def sigma_of(self, colour: Triple, fibre: ChiangFibre) -> Triple:
        return sigma_a_from_colour(colour, fibre.beta_n)


class Chiang(CylinderModel):
    """docs/models/chiang.md."""

    name = "chiang"
    lobes = lobes_of(3)
    header = Path("fibre/chiang/bcsdf.clh")
    reference = "furcl.fibre.chiang.reference"

    @property
    def table(self) -> type[ChiangTable]:
        return ChiangTable

    def features(self, fibre: ChiangFibre, *, residual: bool = False) -> CylinderFeatures:
        """The residual is part of the model, asked for or not."""
        return CylinderFeatures("chiang", tilt=fibre.tilt != 0.0)

    def absorption_of_colour(self, fibre: ChiangFibre, colour: np.ndarray) -> np.ndarray:
        return (np.log(colour) / albedo_polynomial(fibre.beta_n)) ** 2

    def params(self, fibre: ChiangFibre) -> np.ndarray:
        params = super().params(fibre)
        half_turn = math.pi / fibre.azimuthal_scale
        params["beta_m"] = fibre.longitudinal_width
        params["scale"] = fibre.azimuthal_scale
        params["within"] = math.tanh(0.5 * half_turn)
        params["beyond"] = 2.0 / (math.exp(min(half_turn, 700.0)) + 1.0)
        params["normalisation"] = 1.0 / (fibre.azimuthal_scale * math.tanh(0.5 * half_turn))
        return params


MODEL = Chiang()
