"""A cylinder without a medulla as a fibre model: what Chiang's and d'Eon's share.

kernels/include/fibre/cylinder/bcsdf.clh holds their common part.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from furcl.device.layout import Fields, struct_dtype
from furcl.fibre.model import FibreFeatures, FibreModel, Lobe, find

STRUCT: Fields = (
    ("sigma_a", "float4"),  # absorption per fibre radius, one value a channel
    ("eta", "float"),
    ("eta_sq_minus_one", "float"),  # formed in float64: no cancellation near eta = 1
    ("beta_m", "float"),  # longitudinal width of R [rad]
    ("beta_n", "float"),  # azimuthal width, of a Gaussian [rad] ...
    ("scale", "float"),  # ... or of a logistic within a turn,
    ("normalisation", "float"),  # 1 / (scale tanh(pi / (2 scale))),
    ("within", "float"),  # that tanh,
    ("beyond", "float"),  # and 1 minus it
    ("sin_tilt", "float"),  # of a <= 0
    ("cos_tilt", "float"),
    ("sin_tilt_2", "float"),  # of 2 a
    ("cos_tilt_2", "float"),
    ("sin_tilt_4", "float"),  # of 4 a
    ("cos_tilt_4", "float"),
    ("unused_1", "float"),
    ("unused_2", "float"),
)

RESIDUAL = "residual"


def lobes_of(orders: int) -> tuple[Lobe, ...]:
    """R, TT, TRT, the residual, and the lobes of further orders below `orders`, TRRT and so on."""
    names = ["R", "TT", "TRT", RESIDUAL, *(f"T{'R' * (p - 1)}T" for p in range(3, orders))]
    return tuple(Lobe(name, narrow=name != RESIDUAL, h_given_phi=True) for name in names)


@dataclass(frozen=True)
class CylinderFeatures(FibreFeatures):
    """Switches of the header.

    Attributes
    ----------
    of_model : str          name of the model
    orders : int            orders p with lobes of their own, from 3 on
    tilt : bool             alpha != 0
    cone : bool             centre and width of R by the azimuth
    dropped_lobes : tuple   names of lobes left out because they carry next to nothing, or were not
                            asked for
    """

    of_model: str
    orders: int = 3
    tilt: bool = True
    cone: bool = False
    dropped_lobes: tuple[str, ...] = ()

    @property
    def model(self) -> FibreModel:
        return find(self.of_model)

    @property
    def n_lobes(self) -> int:
        return self.orders + 1

    @property
    def lobes(self) -> tuple[str, ...]:
        names = (lobe.name for lobe in self.model.lobes[: self.n_lobes])
        return tuple(name for name in names if name not in self.dropped_lobes)

    @property
    def data_words(self) -> int:
        return 0

    def switches(self) -> Mapping[str, int]:
        return {
            "FURCL_ORDERS": self.orders,
            "FURCL_TILT": int(self.tilt),
            "FURCL_CONE": int(self.cone),
        }

    def without(self, lobes: Collection[str]) -> CylinderFeatures:
        dropped = {*self.dropped_lobes, *lobes}
        names = (lobe.name for lobe in self.model.lobes)
        return replace(self, dropped_lobes=tuple(name for name in names if name in dropped))

    def everything_on(self) -> CylinderFeatures:
        kept = tuple(name for name in self.dropped_lobes if name == RESIDUAL)
        return replace(self, tilt=True, dropped_lobes=kept)

    def optional(self) -> dict[str, tuple[bool, str]]:
        return {"tilt": (self.tilt, "alpha is 0")}

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


class CylinderModel(FibreModel):
    """A cylinder without a medulla. Fibres have eta, sigma_a and tilt."""

    struct = STRUCT
    absorbed = "sigma_a"

    def constants(self) -> Mapping[str, int | str]:
        return {"FURCL_MEDULLA": 0, "FURCL_LAYERED": 0}

    def is_grey(self, fibre: Any) -> bool:
        return len(set(fibre.sigma_a)) == 1

    def params(self, fibre: Any) -> np.ndarray:
        """FibreParams without widths, differences formed in float64."""
        params = np.zeros((), struct_dtype(self.struct))
        params["sigma_a"][:3] = fibre.sigma_a
        params["eta"] = fibre.eta
        params["eta_sq_minus_one"] = (fibre.eta - 1.0) * (fibre.eta + 1.0)
        for name, factor in (("tilt", 1.0), ("tilt_2", 2.0), ("tilt_4", 4.0)):
            params[f"sin_{name}"] = math.sin(factor * fibre.tilt)
            params[f"cos_{name}"] = math.cos(factor * fibre.tilt)
        return params
