"""The same light from everywhere. Its kernel: kernels/include/light/constant.clh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from furcl.light.model import Light
from furcl.light.sample import LightSamples, around_z, from_infinity
from furcl.table import Rgb, Table, triple

Array = NDArray[np.float64]


class ConstantEnvironment(Table, frozen=True, kw_only=True, tag_field="kind", tag="constant"):
    """The same radiance from everywhere.

    Attributes
    ----------
    radiance : (r,g,b)      one number stands for three equal ones
    """

    allowed: ClassVar = {"radiance": (0.0, 1e9)}

    radiance: Rgb = 1.0


@dataclass(frozen=True, eq=False)
class ConstantLight(Light):
    """The same radiance (3,) from everywhere; sampled uniformly."""

    value: Array

    kind = "constant"
    table = ConstantEnvironment
    header = Path("light/constant.clh")
    fields = (("RADIANCE", 3),)
    worth_sampling = False

    @classmethod
    def from_table(cls, table: ConstantEnvironment) -> Self:
        return cls(np.array(triple(table.radiance), np.float64))

    @property
    def grey(self) -> bool:
        return len(set(self.value.tolist())) == 1

    def radiance(self, directions: Array) -> Array:
        return np.broadcast_to(self.value, (len(directions), 3)).copy()

    def pdf(self, points: Array, directions: Array) -> Array:
        return np.full(len(directions), 0.25 / math.pi)

    def sample(self, points: Array, u: Array) -> LightSamples:
        directions = around_z(2.0 * u[:, 0], u[:, 1])
        return from_infinity(directions, self.radiance(directions), self.pdf(points, directions))

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        return self.parameters({"RADIANCE": self.value})
