"""The light of a picture of the whole sphere, `furcl.light.latlong`. Its kernel:
kernels/include/light/image.clh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from furcl.light.latlong import LatLong
from furcl.light.model import Light
from furcl.light.sample import LightSamples, from_infinity
from furcl.table import Table

Array = NDArray[np.float64]


class ImageEnvironment(Table, frozen=True, kw_only=True, tag_field="kind", tag="image"):
    """Image of the surroundings in latitude and longitude, OpenEXR or Radiance (.hdr). Primaries
    other than Rec.709 that its header names are converted.

    Attributes
    ----------
    file : str              the image
    rotation_deg : float    turn about +z [deg]
    scale : float           factor on its radiance
    """

    file: str
    rotation_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    scale: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0


@dataclass(frozen=True, eq=False)
class ImageLight(Light):
    """A latitude-longitude image.

    In its buffer the texels (H, W, 3) follow the parameters, and if it is sampled the running sums
    of the rows (H,) and of the columns of each (H, W).
    """

    image: LatLong

    kind = "image"
    table = ImageEnvironment
    header = Path("light/image.clh")
    fields = (("WIDTH", 1), ("HEIGHT", 1), ("ROTATION", 1))  # rotation in turns

    @classmethod
    def from_table(cls, table: ImageEnvironment) -> Self:
        return cls(LatLong.load(table.file, rotation_deg=table.rotation_deg, scale=table.scale))

    @property
    def n_negative(self) -> int:
        """Pixels with a negative channel, which was set to zero."""
        return self.image.n_negative

    def radiance(self, directions: Array) -> Array:
        return self.image.radiance(directions)

    def pdf(self, points: Array, directions: Array) -> Array:
        return self.image.pdf(directions)

    def sample(self, points: Array, u: Array) -> LightSamples:
        directions, pdf = self.image.sample(u)
        return from_infinity(directions, self.radiance(directions), pdf)

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        height, width, _ = self.image.texels.shape
        parts = [
            self.parameters({"WIDTH": width, "HEIGHT": height, "ROTATION": self.image.rotation}),
            self.image.texels.ravel(),
        ]
        if light_sampling:
            parts += [self.image.marginal, self.image.conditional.ravel()]
        return np.concatenate(parts)
