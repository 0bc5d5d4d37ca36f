"""Yan et al. 2015 as a fibre model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from furcl.device.layout import Fields, struct_dtype
from furcl.fibre.double_cylinder import layout
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.table import FibreTable
from furcl.fibre.model import FibreModel, find
from furcl.fibre.pigment import COLOUR_RANGE, sigma_ca_from_colours
from furcl.fibre.yan2015.features import LOBES, Yan2015Features
from furcl.fibre.yan2015.parameters import RANGES, Yan2015Fibre

if TYPE_CHECKING:
    from furcl.device.choice import Device
    from furcl.fibre.double_cylinder.profiles import MedullaProfiles

# The double cylinder's, the fields that fill it up replaced.
STRUCT: Fields = (
    *(field for field in layout.STRUCT if not field[0].startswith("unused")),
    ("eta_m", "float"),
    ("eta_m_sq_minus_one", "float"),
    ("kappa_sq_e_m", "float"),  # kappa^2 (eta_m^2 - 1), and ...
    ("kappa_sq_e_m_low", "float"),  # ... what float32 leaves of it
    ("index_ratio_sq", "float"),  # (eta_m / eta)^2
    ("index_ratio_sq_minus_one", "float"),
    ("unused_1", "float"),
)


class Yan2015Table(FibreTable, frozen=True, kw_only=True, tag="yan2015"):
    """A preset of the double cylinder, parameters that replace its own, and the colour in at most
    one of three ways.

    Attributes
    ----------
    preset : str            parameters by name, see `furcl.Fibre.preset`
    colour : (r,g,b)        wanted colour of a thick groom, from which sigma_ca follows
    melanin : table         pigments, from which sigma_ca follows
    absorption : table      sigma_ca where it differs between strands or along them
    mode : str              as of the double cylinder: "far", "near", "multiscale"
    eta_m : float           index of refraction of the medulla over that outside the fibre; that of
                            the cortex makes it a double cylinder
    """

    described_by: ClassVar = Fibre
    allowed: ClassVar = {**RANGES, "preset": Fibre.preset_names(), "colour": COLOUR_RANGE}

    eta_m: float = 1.2

    def build(self) -> Yan2015Fibre:
        cortex = super().build()
        values = {field.name: getattr(cortex, field.name) for field in fields(Fibre)}
        return Yan2015Fibre(**values, eta_m=self.eta_m)


class Yan2015(FibreModel):
    """docs/models/yan2015.md."""

    name = "yan2015"
    lobes = LOBES
    header = Path("fibre/yan2015/bcsdf.clh")
    struct = STRUCT
    reference = "furcl.fibre.yan2015.reference"
    absorbed = "sigma_ca"

    @property
    def table(self) -> type[Yan2015Table]:
        return Yan2015Table

    @property
    def _of_one_index(self) -> FibreModel:
        """The double cylinder, with which it shares most."""
        return find("double-cylinder")

    def constants(self) -> Mapping[str, int | str]:
        return layout.CONSTANTS

    def features(self, fibre: Yan2015Fibre, *, residual: bool = False) -> Yan2015Features:
        absorbs = any(s > 0.0 for s in fibre.sigma_ma)
        grey_medulla = len(set(fibre.sigma_ma)) == 1
        return Yan2015Features(
            medulla=fibre.kappa > 0.0,
            scattered=fibre.has_medulla,
            profile_channels=0 if not (fibre.has_medulla and absorbs) else 1 if grey_medulla else 3,
            layered=fibre.layers != 0.5,
            tilt=fibre.tilt != 0.0,
            residual=residual,
        )

    def is_grey(self, fibre: Yan2015Fibre) -> bool:
        return self._of_one_index.is_grey(fibre)

    def params(self, fibre: Yan2015Fibre) -> np.ndarray:
        """FibreParams, differences formed in float64."""
        params = np.zeros((), struct_dtype(self.struct))
        of_cortex = self._of_one_index.params(fibre.cortex)
        of_medulla = self._of_one_index.params(fibre.medulla)
        for name in params.dtype.names or ():
            if name in (of_cortex.dtype.names or ()):
                params[name] = of_cortex[name]
        params["profile_taus_per_cos"] = of_medulla["profile_taus_per_cos"]
        params["eta_m"] = fibre.eta_m
        params["eta_m_sq_minus_one"] = of_medulla["eta_sq_minus_one"]
        params["kappa_sq_e_m"] = of_medulla["kappa_sq_e"]
        params["kappa_sq_e_m_low"] = of_medulla["kappa_sq_e_low"]
        ratio = fibre.eta_m / fibre.eta
        params["index_ratio_sq"] = ratio * ratio
        params["index_ratio_sq_minus_one"] = (
            (fibre.eta_m - fibre.eta) * (fibre.eta_m + fibre.eta) / fibre.eta**2
        )
        return params

    def prepare(self, device: Device, fibre: Yan2015Fibre) -> MedullaProfiles | None:
        """The profiles of the medulla, simulated or loaded; None if it scatters nothing."""
        return self._of_one_index.prepare(device, fibre.medulla)

    def absorption_of_colour(self, fibre: Yan2015Fibre, colour: np.ndarray) -> np.ndarray:
        return sigma_ca_from_colours(colour, fibre.beta_n_deg)

    def data(self, prepared: Any, features: Yan2015Features) -> np.ndarray:
        """The packed profiles; zeros where kernels with scattered lobes run on a fibre without."""
        return self._of_one_index.data(prepared, features)


MODEL = Yan2015()
