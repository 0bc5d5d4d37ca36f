"""Lobes of the model, and what one fibre needs of its header."""

from __future__ import annotations

from dataclasses import dataclass

from furcl.fibre.double_cylinder.features import MedullaFeatures
from furcl.fibre.model import Lobe

RESIDUAL = "residual"
SCATTERED = ("TtTs", "TrRtTs", "TtRtTs")
OF_MEDULLA = ("TrT", "TtT", "TrRrT", "TrRtT", "TtRtT")
LOBES = (
    *(Lobe(name) for name in ("R", "TT", "TRT", *OF_MEDULLA)),
    *(Lobe(name, narrow=False) for name in (*SCATTERED, RESIDUAL)),
)


@dataclass(frozen=True)
class Yan2015Features(MedullaFeatures):
    """Its `medulla` is there where kappa > 0, as it refracts."""

    of_model = "yan2015"
    all_lobes = LOBES
    of_medulla = OF_MEDULLA
    of_profiles = SCATTERED

    def defines(self) -> dict[str, int | str]:
        """Names of lobes differ by their case."""
        found = super().defines()
        upper = {f"FURCL_LOBE_{lobe.name.upper()}" for lobe in LOBES}
        kept = {name: value for name, value in found.items() if name not in upper}
        return {**kept, **{f"FURCL_LOBE_{lobe.name}": f"{i}u" for i, lobe in enumerate(LOBES)}}
