"""Marschner et al. 2003 as a fibre model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from furcl.device.layout import Fields, struct_dtype
from furcl.errors import FibreError
from furcl.fibre.closed.model import ClosedFeatures
from furcl.fibre.cylinder.presets import PIGMENTS
from furcl.fibre.cylinder.table import CylinderTable
from furcl.fibre.marschner.parameters import RANGES, MarschnerFibre
from furcl.fibre.model import FibreModel, Lobe
from furcl.fibre.pigment import COLOUR_RANGE, albedo_polynomial, check_colour
from furcl.fibre.ranges import Triple

STRUCT: Fields = (
    ("sigma_a", "float4"),  # absorption per fibre radius, one value a channel
    ("eta", "float"),
    ("eta_sq_minus_one", "float"),  # formed in float64: no cancellation near eta = 1
    ("twice_norm", "float"),
    ("glint", "float"),  # k_G
    ("caustic_width", "float"),  # [rad]
    ("caustic_fade", "float"),  # of eta'
    ("caustic_limit", "float"),  # of h
    ("shift_r", "float"),  # of the half sum of inclinations [rad]
    ("shift_tt", "float"),
    ("shift_trt", "float"),
    ("width_r", "float"),  # its standard deviation [rad]
    ("width_tt", "float"),
    ("width_trt", "float"),
    ("least_cos_r", "float"),  # of the inclinations whose energy a lobe is chosen by
    ("least_cos_tt", "float"),
    ("least_cos_trt", "float"),
)

REACH = 1.5
"""Widths of a lobe that light near the fibre's axis is taken to come back from: nearer to the axis
a lobe is chosen by its energy at this distance."""


class MarschnerTable(CylinderTable, frozen=True, kw_only=True, tag="marschner"):
    """A fibre of Marschner et al. 2003: human hair by pigment, or parameters of one's own; the
    colour in one of three ways.

    Attributes
    ----------
    preset : str            absorption by name
    colour : (r,g,b)        wanted colour of a thick groom, from which sigma_a follows
    melanin : table         pigments, from which sigma_a follows
    absorption : table      sigma_a where it differs between strands or along them
    mode : str              "far" alone: no offset is left in the model
    """

    described_by: ClassVar = MarschnerFibre
    allowed: ClassVar = {**RANGES, "preset": tuple(PIGMENTS), "colour": COLOUR_RANGE}

    beta_deg: float | None = None
    glint: float | None = None
    caustic_width_deg: float | None = None
    caustic_fade: float | None = None
    caustic_limit: float | None = None
    norm: Annotated[Literal["unit", "published"], Meta(examples=["published"])] = "unit"

    def sigma_of(self, colour: Triple, fibre: MarschnerFibre) -> Triple:
        r, g, b = ((math.log(c) / albedo_polynomial(0.0)) ** 2 for c in check_colour(colour))
        return r, g, b


class Marschner(FibreModel):
    """docs/models/marschner.md."""

    name = "marschner"
    has_offset = False
    lobes = tuple(Lobe(name, h_given_phi=True) for name in ("R", "TT", "TRT"))
    header = Path("fibre/marschner/bcsdf.clh")
    struct = STRUCT
    reference = "furcl.fibre.marschner.reference"
    absorbed = "sigma_a"

    @property
    def table(self) -> type[MarschnerTable]:
        return MarschnerTable

    def constants(self) -> Mapping[str, int | str]:
        return {"FURCL_MEDULLA": 0, "FURCL_LAYERED": 0}

    def features(self, fibre: MarschnerFibre, *, residual: bool = False) -> ClosedFeatures:
        """There is no residual: later orders are missing.

        Raises
        ------
        FibreError      an elliptical fibre
        """
        if fibre.axis_ratio != 1.0:
            raise FibreError(
                f"fibre.axis_ratio = {fibre.axis_ratio} - strands have no frame that tells the "
                f"axes of an ellipse apart - allowed on a device is 1; furcl.models.find"
                f"('marschner').reference evaluates others"
            )
        return ClosedFeatures("marschner")

    def is_grey(self, fibre: MarschnerFibre) -> bool:
        return len(set(fibre.sigma_a)) == 1

    def absorption_of_colour(self, fibre: MarschnerFibre, colour: np.ndarray) -> np.ndarray:
        return (np.log(colour) / albedo_polynomial(0.0)) ** 2

    def warning(self, fibre: MarschnerFibre) -> str | None:
        if fibre.norm == "unit":
            return None
        return (
            "norm = 'published' returns twice the light that the fibre takes in, ever more with "
            "each bounce; norm = 'unit' is half of it"
        )

    def params(self, fibre: MarschnerFibre) -> np.ndarray:
        params = np.zeros((), struct_dtype(self.struct))
        params["sigma_a"][:3] = fibre.sigma_a
        params["eta_sq_minus_one"] = (fibre.eta - 1.0) * (fibre.eta + 1.0)
        for name in ("eta", "twice_norm", "glint", "caustic_width", "caustic_fade"):
            params[name] = getattr(fibre, name)
        params["caustic_limit"] = fibre.caustic_limit
        for name, along in zip(("r", "tt", "trt"), fibre.lobes, strict=True):
            params[f"shift_{name}"], params[f"width_{name}"] = along
            params[f"least_cos_{name}"] = math.sin(min(REACH * along.width, 0.5 * math.pi))
        return params


MODEL = Marschner()
