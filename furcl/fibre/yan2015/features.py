"""Lobes of the model, and what one fibre needs of its header."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from furcl.fibre.double_cylinder import layout
from furcl.fibre.model import FibreFeatures, Lobe, find

if TYPE_CHECKING:
    from furcl.fibre.model import FibreModel

RESIDUAL = "residual"
SCATTERED = ("TtTs", "TrRtTs", "TtRtTs")
OF_MEDULLA = ("TrT", "TtT", "TrRrT", "TrRtT", "TtRtT")
LOBES = (
    *(Lobe(name) for name in ("R", "TT", "TRT", *OF_MEDULLA)),
    *(Lobe(name, narrow=False) for name in (*SCATTERED, RESIDUAL)),
)


@dataclass(frozen=True)
class Yan2015Features(FibreFeatures):
    """Switches of the header.

    Attributes
    ----------
    medulla : bool              there is a medulla (kappa > 0)
    scattered : bool            it scatters (sigma_ms > 0)
    profile_channels : int      channels of medulla absorption in the profiles: 0, 1 or 3
    layered : bool              cuticle other than a plain interface (layers != 1/2)
    tilt : bool                 alpha != 0
    residual : bool             lobe that holds all others and closes the furnace
    dropped_lobes : tuple       names of lobes left out because they carry next to nothing
    """

    medulla: bool = True
    scattered: bool = True
    profile_channels: int = 3
    layered: bool = True
    tilt: bool = True
    residual: bool = False
    dropped_lobes: tuple[str, ...] = ()

    @property
    def model(self) -> FibreModel:
        return find("yan2015")

    @property
    def n_lobes(self) -> int:
        return len(LOBES) if self.residual else len(LOBES) - 1

    @property
    def lobes(self) -> tuple[str, ...]:
        absent = set(self.dropped_lobes)
        if not self.medulla:
            absent |= set(OF_MEDULLA)
        if not self.scattered:
            absent |= set(SCATTERED)
        return tuple(lobe.name for lobe in LOBES[: self.n_lobes] if lobe.name not in absent)

    @property
    def data_words(self) -> int:
        return layout.profile_words(self.profile_channels) if self.scattered else 0

    def switches(self) -> Mapping[str, int]:
        return {
            f"FURCL_{name.upper()}": int(value)
            for name, value in asdict(self).items()
            if name != "dropped_lobes"
        }

    def defines(self) -> dict[str, int | str]:
        """Names of lobes differ by their case."""
        found = super().defines()
        upper = {f"FURCL_LOBE_{lobe.name.upper()}" for lobe in LOBES}
        kept = {name: value for name, value in found.items() if name not in upper}
        return {**kept, **{f"FURCL_LOBE_{lobe.name}": f"{i}u" for i, lobe in enumerate(LOBES)}}

    def without(self, lobes: Collection[str]) -> Yan2015Features:
        kept = replace(self, dropped_lobes=tuple(name for name in self.lobes if name in lobes))
        if not set(kept.lobes) & set(SCATTERED):
            kept = replace(kept, scattered=False, profile_channels=0)
        return kept

    def everything_on(self) -> Yan2015Features:
        return Yan2015Features(residual=self.residual)

    def optional(self) -> dict[str, tuple[bool, str]]:
        return {
            "medulla": (self.medulla, "kappa is 0"),
            "scattered": (self.scattered, "kappa or sigma_ms is 0: scattered lobes, profiles"),
            "profile_channels": (
                self.profile_channels > 0,
                "sigma_ma is 0: no medulla absorption",
            ),
            "layered": (self.layered, "layers is 1/2: the cuticle is a plain interface"),
            "tilt": (self.tilt, "alpha is 0"),
            "residual": (self.residual, "render.residual is false: lobe of all other orders"),
        }

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)
