"""A light from outside furcl: a sphere in the scene that only light samples see."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from furcl.light import kinds
from furcl.light.model import Light
from furcl.light.sample import LightSamples, around_z
from furcl.table import Length, Rgb, Table, Vec3, triple

Array = NDArray[np.float64]


class SphereTable(Table, frozen=True, kw_only=True, tag_field="kind", tag="sphere"):
    """Where the sphere is and what it sends out."""

    centre: Vec3
    radius: Length
    radiance: Rgb = 1.0


@dataclass(frozen=True, eq=False)
class SphereLamp(Light):
    """A sphere that shines alike in all directions; a point inside it gets no light."""

    centre: Array
    radius: float
    value: Array

    kind = "sphere"
    table = SphereTable
    header = Path(__file__).parent / "sphere_lamp.clh"
    fields = (("CENTRE", 3), ("RADIUS", 1), ("RADIANCE", 3))
    at_infinity = False

    @classmethod
    def from_table(cls, table: SphereTable) -> Self:
        return cls(np.array(table.centre), table.radius, np.array(triple(table.radiance)))

    def radiance(self, directions: Array) -> Array:
        return np.zeros((len(directions), 3))

    def pdf(self, points: Array, directions: Array) -> Array:
        axis, _, one_minus_cos = self._seen(points, len(directions))
        chord = directions - axis
        inside = np.sum(chord * chord, axis=1) <= 2.0 * one_minus_cos
        return np.where(inside, _cone_density(one_minus_cos), 0.0)

    def sample(self, points: Array, u: Array) -> LightSamples:
        axis, distance, edge = self._seen(points, len(u))
        one_minus_cos = u[:, 0] * edge
        cone = around_z(one_minus_cos, u[:, 1])
        side = np.where(np.abs(axis[:, 2:]) > 0.5, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
        tangent = np.cross(side, axis)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        frame = np.stack([tangent, np.cross(axis, tangent), axis], axis=1)
        directions = np.einsum("ni,nij->nj", cone, frame)
        aside_sq = distance**2 * one_minus_cos * (2.0 - one_minus_cos)
        inside = np.sqrt(np.maximum(self.radius**2 - aside_sq, 0.0))
        return LightSamples(
            directions,
            distance * cone[:, 2] - inside,
            np.tile(self.value, (len(u), 1)),
            _cone_density(edge),
        )

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        return self.parameters(
            {"CENTRE": self.centre, "RADIUS": self.radius, "RADIANCE": self.value}
        )

    def _seen(self, points: Array, n: int) -> tuple[Array, Array, Array]:
        """Direction (n, 3) and distance (n,) of the centre, 1 - cos of the angular radius (n,)."""
        to_centre = np.broadcast_to(self.centre - points, (n, 3))
        distance = np.maximum(np.linalg.norm(to_centre, axis=1), 1e-18)
        sine = np.minimum(self.radius / distance, 1.0)
        one_minus_cos = np.where(sine < 1.0, sine**2 / (1.0 + np.sqrt(1.0 - sine**2)), 0.0)
        return to_centre / distance[:, None], distance, one_minus_cos


def _cone_density(one_minus_cos: Array) -> Array:
    """Density of directions uniform in a cone; 0 for an empty one."""
    cone = 2.0 * math.pi * one_minus_cos
    return np.divide(1.0, cone, out=np.zeros_like(cone), where=cone > 0.0)


@contextmanager
def registered_lamp() -> Iterator[None]:
    """Scenes know the kind "sphere" within the block."""
    kinds.register(SphereLamp)
    try:
        yield
    finally:
        kinds.unregister("sphere")


SPHERE = {"kind": "sphere", "centre": [0.5, -2.0, 1.5], "radius": 0.4, "radiance": [1, 2, 3]}


def lit_fibre(environment, **render):
    """A short fibre that fills the picture from far away, and the light on it."""
    return {
        "film": {"width": 4, "height": 4, "filter": "box"},
        "camera": {"origin": [0, -200, 0], "target": [0, 0, 0], "vfov_deg": 0.1},
        "fibre": {"preset": "human-white", "kappa": 0.0, "beta_m_deg": 20.0, "beta_n_deg": 30.0},
        "environment": environment,
        "curves": {"generator": "fibre", "axis": "x", "radius": 0.2, "length": 2.0},
        "render": {"max_depth": 1, **render},
    }  # fmt: skip
