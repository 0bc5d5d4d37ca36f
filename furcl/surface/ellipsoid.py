"""An ellipsoid inside the groom."""

from __future__ import annotations

import math
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import struct_dtype
from furcl.surface.model import Surface, SurfacePart
from furcl.table import Length, Rgb, Vec3, triple

PART = SurfacePart(
    "ellipsoid",
    Path("surface/ellipsoid.clh"),
    (("centre", "float4"), ("inv_radii", "float4"), ("albedo", "float4")),
)


class Body(Surface, frozen=True, kw_only=True, tag_field="kind", tag="ellipsoid"):
    """Diffuse ellipsoid inside the groom that stops light.

    Attributes
    ----------
    centre : (x, y, z)      its centre [unit]
    radii : (x, y, z)       its half axes [unit]
    albedo : (r,g,b)        what it reflects; one number stands for three equal ones
    """

    allowed: ClassVar = {"albedo": (0.0, 1.0)}

    part: ClassVar[SurfacePart] = PART

    centre: Vec3 = (0.0, 0.0, 0.0)
    radii: tuple[Length, Length, Length] = (1.0, 1.0, 1.0)
    albedo: Rgb = 0.05

    @property
    def is_grey(self) -> bool:
        return len(set(triple(self.albedo))) == 1

    def params(self) -> np.ndarray:
        out = np.zeros((), struct_dtype(PART.struct))
        out["centre"][:3] = self.centre
        out["inv_radii"][:3] = np.reciprocal(np.array(self.radii, np.float64))
        out["albedo"][:3] = triple(self.albedo)
        return out

    def contains(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        return (np.square((places - self.centre) / self.radii)).sum(axis=1) < 1.0

    def points(self) -> NDArray[np.float64]:
        n = 2000
        z = (2.0 * np.arange(n) + 1.0) / n - 1.0
        phi = np.arange(n) * (math.pi * (3.0 - math.sqrt(5.0)))
        level = np.sqrt(1.0 - z * z)
        unit = np.stack([level * np.cos(phi), level * np.sin(phi), z], axis=1)
        return np.array(self.centre) + unit * np.array(self.radii)


#: An ellipsoid that no ray meets.
NOWHERE = Body(centre=(1e9, 1e9, 1e9))
