"""Features of models whose scattering function knows no offset h."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from furcl.fibre.model import FibreFeatures, FibreModel, find


@dataclass(frozen=True)
class ClosedFeatures(FibreFeatures):
    """Switches of the header: there are none but the lobes.

    Attributes
    ----------
    of_model : str          name of the model
    dropped_lobes : tuple   names of lobes left out because they carry next to nothing
    """

    of_model: str
    dropped_lobes: tuple[str, ...] = ()

    @property
    def model(self) -> FibreModel:
        return find(self.of_model)

    @property
    def n_lobes(self) -> int:
        return len(self.model.lobes)

    @property
    def lobes(self) -> tuple[str, ...]:
        names = (lobe.name for lobe in self.model.lobes)
        return tuple(name for name in names if name not in self.dropped_lobes)

    @property
    def data_words(self) -> int:
        return 0

    def switches(self) -> Mapping[str, int]:
        return {}

    def without(self, lobes: Collection[str]) -> ClosedFeatures:
        dropped = {*self.dropped_lobes, *lobes}
        names = (lobe.name for lobe in self.model.lobes)
        return replace(self, dropped_lobes=tuple(name for name in names if name in dropped))

    def everything_on(self) -> ClosedFeatures:
        return replace(self, dropped_lobes=())

    def optional(self) -> dict[str, tuple[bool, str]]:
        return {}

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)
