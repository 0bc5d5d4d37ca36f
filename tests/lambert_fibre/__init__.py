"""A fibre model from outside furcl: a Lambertian surface, one smooth lobe and nothing prepared."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from furcl.device.layout import struct_dtype
from furcl.errors import FibreError
from furcl.fibre import model as models
from furcl.fibre.model import FibreFeatures, FibreModel, Lobe, ModelTable
from furcl.table import Rgb, Triple, triple


@dataclass(frozen=True)
class LambertFibre:
    """Parameters of a fibre.

    Attributes
    ----------
    albedo : (3,)   reflectance, 0..1
    rim : float     share of the light that is lost where the ray grazes the fibre, 0..1
    """

    albedo: Triple = (1.0, 1.0, 1.0)
    rim: float = 0.0
    model: ClassVar[str] = "lambert"

    def __post_init__(self) -> None:
        for name, values in (("albedo", self.albedo), ("rim", (self.rim,))):
            if not all(0.0 <= value <= 1.0 for value in values):
                raise FibreError(f"fibre.{name} = {getattr(self, name)} - allowed is 0 to 1")


class LambertTable(ModelTable, frozen=True, kw_only=True, tag_field="model", tag="lambert"):
    """The table [fibre] of such a fibre."""

    albedo: Rgb = 1.0
    rim: float = 0.0

    def build(self) -> LambertFibre:
        return LambertFibre(triple(self.albedo), self.rim)


@dataclass(frozen=True)
class LambertFeatures(FibreFeatures):
    """Switches of the header: whether the rim reflects less."""

    rim: bool = True
    dropped_lobes: tuple[str, ...] = ()

    @property
    def model(self) -> Lambert:
        return MODEL

    @property
    def n_lobes(self) -> int:
        return 1

    @property
    def data_words(self) -> int:
        return 0

    @property
    def lobes(self) -> tuple[str, ...]:
        return tuple(lobe.name for lobe in MODEL.lobes if lobe.name not in self.dropped_lobes)

    def switches(self) -> Mapping[str, int]:
        return {"FURCL_RIM": int(self.rim)}

    def without(self, lobes: Collection[str]) -> LambertFeatures:
        return replace(self, dropped_lobes=tuple(lobes))

    def everything_on(self) -> LambertFeatures:
        return LambertFeatures()

    def optional(self) -> dict[str, tuple[bool, str]]:
        return {"rim": (self.rim, "rim is 0: the same energy at every offset")}

    def as_dict(self) -> Mapping[str, Any]:
        return {"rim": self.rim, "dropped_lobes": self.dropped_lobes}


class Lambert(FibreModel):
    """A Lambertian surface."""

    name = "lambert"
    lobes = (Lobe("diffuse", narrow=False),)
    header = Path(__file__).parent / "bcsdf.clh"
    struct = (
        ("albedo", "float4"),
        ("rim", "float"),
        ("unused_1", "float"),
        ("unused_2", "float"),
        ("unused_3", "float"),
    )
    reference = "lambert_fibre.reference"

    @property
    def table(self) -> type[LambertTable]:
        return LambertTable

    def features(self, fibre: LambertFibre, *, residual: bool = False) -> LambertFeatures:
        return LambertFeatures(rim=fibre.rim > 0.0)

    def is_grey(self, fibre: LambertFibre) -> bool:
        return len(set(fibre.albedo)) == 1

    def params(self, fibre: LambertFibre) -> np.ndarray:
        params = np.zeros((), struct_dtype(self.struct))
        params["albedo"][:3] = fibre.albedo
        params["rim"] = fibre.rim
        return params


MODEL = Lambert()


@contextmanager
def registered_lambert() -> Iterator[FibreModel]:
    """Scenes know the model "lambert" within the block."""
    models.register(MODEL)
    try:
        yield MODEL
    finally:
        models.unregister("lambert")


def document(fibre: LambertFibre) -> dict[str, Any]:
    """A fibre as a table of a scene."""
    return {"model": "lambert", **asdict(fibre)}
