"""What a surface beside the strands is: its table in a scene and its part of the kernels."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import Fields
from furcl.table import Table


@dataclass(frozen=True)
class SurfacePart:
    """What kernels are built from: the part <surface> of furcl.device.features.

    Attributes
    ----------
    name : str          kind of the surface
    header : Path       file in kernels/include, or absolute; defines surface_hit and surface_point
    struct : Fields     of SurfaceParams
    """

    name: str
    header: Path
    struct: Fields

    def defines(self) -> dict[str, int | str]:
        """None."""
        return {}

    def structs(self) -> dict[str, Fields]:
        """SurfaceParams."""
        return {"SurfaceParams": self.struct}

    def as_dict(self) -> dict[str, Any]:
        """Nothing beside the name."""
        return {}


class Surface(Table, frozen=True, kw_only=True):
    """Base of the tables of surfaces: opaque, diffuse."""

    part: ClassVar[SurfacePart]

    @property
    @abstractmethod
    def is_grey(self) -> bool:
        """Whether one channel tells all."""

    @abstractmethod
    def params(self) -> np.ndarray:
        """The struct SurfaceParams."""

    def contains(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of places (n, 3) are inside, (n,), for warnings; a surface may not know: none."""
        return np.zeros(len(places), bool)

    @abstractmethod
    def points(self) -> NDArray[np.float64]:
        """Points (n, 3) spread over the surface, by which a camera frames it."""
