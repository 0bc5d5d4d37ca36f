"""An ellipsoid inside the groom: its table in a scene, and what the kernels take of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from furcl.device import layout
from furcl.table import Length, Rgb, Table, Vec3, check_range, triple

# Where the body is that kernels with body code get for a scene without one.
NOWHERE = 1e12


class Body(Table, frozen=True, kw_only=True):
    """Diffuse ellipsoid inside the groom that stops light."""

    centre: Vec3 = (0.0, 0.0, 0.0)
    radii: tuple[Length, Length, Length] = (1.0, 1.0, 1.0)
    albedo: Rgb = 0.05

    def __post_init__(self) -> None:
        check_range("albedo", self.albedo, 0.0, 1.0)

    def surface_points(self) -> NDArray[np.float64]:
        """Points (n, 3) spread over the ellipsoid."""
        n = 2000
        z = (2.0 * np.arange(n) + 1.0) / n - 1.0
        phi = np.arange(n) * (math.pi * (3.0 - math.sqrt(5.0)))
        level = np.sqrt(1.0 - z * z)
        unit = np.stack([level * np.cos(phi), level * np.sin(phi), z], axis=1)
        return np.array(self.centre) + unit * np.array(self.radii)


def body_struct(body: Body | None) -> np.ndarray:
    """The struct Body of a body; of none a unit sphere that no ray meets."""
    out = np.zeros((), layout.struct_dtype("Body"))
    out["centre"][:3], out["inv_radii"][:3] = NOWHERE, 1.0
    if body is not None:
        out["centre"][:3] = body.centre
        out["inv_radii"][:3] = np.reciprocal(np.array(body.radii, np.float64))
        out["albedo"][:3] = triple(body.albedo)
    return out
