"""What one double cylinder needs of kernels/include/fibre/double_cylinder, and one fibre with a
medulla of its model's header."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

from furcl.fibre.double_cylinder import layout
from furcl.fibre.model import FibreFeatures, Lobe, find

if TYPE_CHECKING:
    from furcl.fibre.model import FibreModel


@dataclass(frozen=True)
class MedullaFeatures(FibreFeatures):
    """Switches of the header of a model whose fibres have a medulla; subclasses name the model.

    Attributes
    ----------
    medulla : bool              rays may cross a medulla that matters
    scattered : bool            it scatters (kappa > 0 and sigma_ms > 0)
    profile_channels : int      channels of absorption in the profiles: 0, 1 or 3
    simulated : bool            scattered light leaves as simulated, instead of by profiles, and the
                                residual lobe as light of its orders does
    layered : bool              cuticle other than a plain interface (layers != 1/2)
    tilt : bool                 alpha != 0
    residual : bool             lobe that holds all others and closes the furnace
    dropped_lobes : tuple       names of lobes left out because they carry next to nothing
    """

    of_model: ClassVar[str]
    all_lobes: ClassVar[tuple[Lobe, ...]]
    of_medulla: ClassVar[tuple[str, ...]] = ()
    of_profiles: ClassVar[tuple[str, ...]]

    medulla: bool = True
    scattered: bool = True
    profile_channels: int = 3
    layered: bool = True
    tilt: bool = True
    residual: bool = False
    simulated: bool = False
    dropped_lobes: tuple[str, ...] = ()

    @property
    def model(self) -> FibreModel:
        return find(self.of_model)

    @property
    def n_lobes(self) -> int:
        return len(self.all_lobes) if self.residual else len(self.all_lobes) - 1

    @property
    def lobes(self) -> tuple[str, ...]:
        absent = set(self.dropped_lobes)
        if not self.medulla:
            absent |= set(self.of_medulla)
        if not self.scattered:
            absent |= set(self.of_profiles)
        return tuple(
            lobe.name for lobe in self.all_lobes[: self.n_lobes] if lobe.name not in absent
        )

    @property
    def data_words(self) -> int:
        if not self.scattered:
            return 0
        words = layout.simulated_words if self.simulated else layout.profile_words
        return words(self.profile_channels)

    def switches(self) -> Mapping[str, int]:
        return {
            f"FURCL_{name.upper()}": int(value)
            for name, value in asdict(self).items()
            if name != "dropped_lobes"
        }

    def without(self, lobes: Collection[str]) -> Self:
        kept = replace(self, dropped_lobes=tuple(name for name in self.lobes if name in lobes))
        if not set(kept.lobes) & set(self.of_profiles):
            kept = replace(kept, scattered=False, profile_channels=0)
        return kept

    def everything_on(self) -> Self:
        return type(self)(residual=self.residual, simulated=self.simulated)

    def optional(self) -> dict[str, tuple[bool, str]]:
        lobes = f"lobes {', '.join(self.of_profiles)}"
        return {
            "medulla": (self.medulla, "kappa is 0, or nothing happens in the medulla"),
            "scattered": (self.scattered, f"kappa or sigma_ms is 0: {lobes}, profiles"),
            "profile_channels": (
                self.profile_channels > 0,
                "sigma_ma is 0: no medulla absorption",
            ),
            "simulated": (self.simulated, "fibre.scattering is 'model'"),
            "layered": (self.layered, "layers is 1/2: the cuticle is a plain interface"),
            "tilt": (self.tilt, "alpha is 0"),
            "residual": (
                self.residual,
                "render.residual is false and scattering 'model': lobe of all other orders",
            ),
        }

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class DoubleCylinderFeatures(MedullaFeatures):
    """Its `medulla` is there where it absorbs or scatters; the residual holds TRRT and later
    orders."""

    of_model = "double-cylinder"
    all_lobes = layout.LOBES
    of_profiles = layout.SCATTERED
