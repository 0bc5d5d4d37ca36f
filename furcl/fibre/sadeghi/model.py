"""Sadeghi et al. 2010 as a fibre model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from furcl.device.layout import Fields, struct_dtype
from furcl.fibre.closed.model import ClosedFeatures
from furcl.fibre.model import FibreModel, Lobe, ModelTable
from furcl.fibre.sadeghi.parameters import (
    INTENSITIES,
    PRESETS,
    RANGES,
    SadeghiFibre,
    largest_albedo,
    preset,
)
from furcl.table import Rgb

STRUCT: Fields = (
    ("intensity_r", "float4"),  # heights, scaled where the fibre asks for it
    ("intensity_tt", "float4"),
    ("intensity_trt", "float4"),
    ("shift_r", "float"),  # of the half sum of inclinations [rad]
    ("shift_tt", "float"),
    ("shift_trt", "float"),
    ("width_r", "float"),  # its standard deviation [rad]
    ("width_tt", "float"),
    ("width_trt", "float"),
    ("glint", "float"),  # height of the glints over that of TRT
    ("glint_angle", "float"),  # [rad]
    ("spread_tt", "float"),  # azimuthal standard deviations [rad]
    ("spread_glint", "float"),
    ("unused_1", "float"),
    ("unused_2", "float"),
)


class SadeghiTable(ModelTable, frozen=True, kw_only=True, tag_field="model", tag="sadeghi"):
    """A fibre of Sadeghi et al. 2010: every lobe by itself, or a preset.

    Attributes
    ----------
    preset : str            parameters by name
    absorption : table      not of this model: its lobes have colours
    mode : str              "far" alone: no offset is left in the model
    """

    described_by: ClassVar = SadeghiFibre
    allowed: ClassVar = {**RANGES, "preset": tuple(PRESETS)}

    preset: Annotated[str | None, Meta(examples=["production"])] = None
    intensity_r: Rgb | None = None
    intensity_tt: Rgb | None = None
    intensity_trt: Rgb | None = None
    glint: float | None = None
    alpha_r_deg: float | None = None
    alpha_tt_deg: float | None = None
    alpha_trt_deg: float | None = None
    beta_r_deg: float | None = None
    beta_tt_deg: float | None = None
    beta_trt_deg: float | None = None
    gamma_tt_deg: float | None = None
    gamma_glint_deg: float | None = None
    glint_deg: float | None = None
    normalise: bool | None = None

    def __post_init__(self) -> None:
        if self.absorption is not None:
            raise ValueError(
                "absorption: the lobes of model = 'sadeghi' have colours and no absorption; leave "
                "it out, or take another model"
            )

    def build(self) -> SadeghiFibre:
        """The fibre that the table describes.

        Raises
        ------
        FibreError      unknown preset, or a value outside its range
        """
        return SadeghiFibre(**({} if self.preset is None else preset(self.preset)) | self.given())


class Sadeghi(FibreModel):
    """docs/models/sadeghi.md."""

    name = "sadeghi"
    has_offset = False
    lobes = tuple(Lobe(name, h_given_phi=True) for name in ("R", "TT", "TRT", "glint"))
    header = Path("fibre/sadeghi/bcsdf.clh")
    struct = STRUCT
    reference = "furcl.fibre.sadeghi.reference"

    @property
    def table(self) -> type[SadeghiTable]:
        return SadeghiTable

    def features(self, fibre: SadeghiFibre, *, residual: bool = False) -> ClosedFeatures:
        """There is no residual: nothing says what is left."""
        return ClosedFeatures("sadeghi", () if fibre.glint > 0.0 else ("glint",))

    def is_grey(self, fibre: SadeghiFibre) -> bool:
        return all(len(set(getattr(fibre, name))) == 1 for name in INTENSITIES)

    def warning(self, fibre: SadeghiFibre) -> str | None:
        largest = 1.0 if fibre.normalise else largest_albedo(fibre)
        if largest <= 1.001:
            return None
        return (
            f"its albedo is up to {largest:.3g}: more light leaves it than meets it, ever more "
            f"with each bounce; normalise = true scales its intensities"
        )

    def params(self, fibre: SadeghiFibre) -> np.ndarray:
        params = np.zeros((), struct_dtype(self.struct))
        scale = fibre.scale
        for name in INTENSITIES:
            params[name][:3] = scale * np.array(getattr(fibre, name))
        for lobe in ("r", "tt", "trt"):
            params[f"shift_{lobe}"] = math.radians(getattr(fibre, f"alpha_{lobe}_deg"))
            params[f"width_{lobe}"] = math.radians(getattr(fibre, f"beta_{lobe}_deg"))
        params["glint"] = fibre.glint
        params["glint_angle"] = math.radians(fibre.glint_deg)
        params["spread_tt"] = math.radians(fibre.gamma_tt_deg)
        params["spread_glint"] = math.radians(fibre.gamma_glint_deg)
        return params


MODEL = Sadeghi()
