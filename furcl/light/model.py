"""What every light is: its table in a scene, its host twin, and its part of the kernels."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.device.layout import Fields
from furcl.errors import LightError
from furcl.image.colour import luminance
from furcl.light.sample import LightSamples
from furcl.table import Table

Array = NDArray[np.float64]

FLUENCE_SAMPLES = 4096
GOLDEN_RATIO = 0.6180339887498949


@dataclass(frozen=True)
class LightPart:
    """What kernels are built from where a scene has this light: the part <light> of their features.

    Attributes
    ----------
    name : str              kind of the light
    header : Path           file in kernels/include, or absolute
    fields : tuple          parameters at the start of the light's buffer: name and number of floats
    at_infinity : bool      rays that leave the scene may find the light; if not, only light samples
                            do, and shadow rays end at their distance
    """

    name: str
    header: Path
    fields: tuple[tuple[str, int], ...]
    at_infinity: bool = True

    def defines(self) -> dict[str, int | str]:
        """LIGHT_<NAME>, where a parameter begins in the buffer, and LIGHT_SIZE, where all end."""
        offsets: dict[str, int | str] = {}
        at = 0
        for name, width in self.fields:
            offsets[f"LIGHT_{name}"] = f"{at}u"
            at += width
        return {**offsets, "LIGHT_SIZE": f"{at}u"}

    def structs(self) -> dict[str, Fields]:
        """None: the buffer holds floats only."""
        return {}

    def as_dict(self) -> dict[str, Any]:
        """Nothing beside the name."""
        return {}


class Light(ABC):
    """A light, on the host in float64: what its header computes on the device.

    World z is up. Points are where light arrives, (n, 3) or one (3,) for all; directions are unit
    (n, 3), from the point towards the light. Densities are per solid angle [1/sr], and positive
    wherever light comes from that `sample` is to find.

    Attributes of a class
    ---------------------
    kind : str              its name in scenes
    table : type            of its table in scenes, a tagged `furcl.table.Table`: kind = "..."
    header : Path           its functions in OpenCL C: light_radiance, light_sample, light_density
    fields : tuple          parameters at the start of its buffer: name and number of floats
    at_infinity : bool      it surrounds the scene: rays that leave the scene find it too. If not,
                            light samples alone do.
    worth_sampling : bool   sampling it reduces noise: not all directions bring the same
    """

    kind: ClassVar[str]
    table: ClassVar[type[Table]]
    header: ClassVar[Path]
    fields: ClassVar[tuple[tuple[str, int], ...]]
    at_infinity: ClassVar[bool] = True
    worth_sampling: ClassVar[bool] = True

    @classmethod
    @abstractmethod
    def from_table(cls, table: Any) -> Self:
        """The light of a scene's table, an instance of `table`; files are read here.

        Raises
        ------
        FurclError      if the light cannot be made from what the table says
        """

    @classmethod
    def part(cls) -> LightPart:
        """What kernels are built from."""
        return LightPart(cls.kind, cls.header, cls.fields, cls.at_infinity)

    @property
    def n_negative(self) -> int:
        """Values below zero that were read and set to zero."""
        return 0

    @property
    def grey(self) -> bool:
        """Whether all of its radiance is the same in all channels."""
        return False

    @abstractmethod
    def radiance(self, directions: Array) -> Array:
        """Radiance (n, 3) that a ray brings which leaves the scene; 0 unless `at_infinity`."""

    @abstractmethod
    def pdf(self, points: Array, directions: Array) -> Array:
        """Density (n,) of the directions that `sample` takes at the points."""

    @abstractmethod
    def sample(self, points: Array, u: Array) -> LightSamples:
        """Directions to the light, one for each row of uniform numbers (n, 2) in [0, 1)."""

    def fluence(self, place: Array) -> float:
        """Luminance of radiance over all directions as it arrives at a place (3,) [sr times the
        unit of radiance], about: the mean of FLUENCE_SAMPLES evenly spread light samples.

        Where there are lamps too, it says how often light samples take this light.
        """
        i = np.arange(FLUENCE_SAMPLES)
        u = np.stack(
            [(i + 0.5) / FLUENCE_SAMPLES, i * GOLDEN_RATIO % 1.0], axis=1, dtype=np.float64
        )
        samples = self.sample(np.broadcast_to(place, (len(u), 3)), u)
        bright = np.asarray(luminance(samples.radiance), np.float64)
        seen = samples.pdf > 0.0
        return float(np.mean(np.where(seen, bright / np.where(seen, samples.pdf, 1.0), 0.0)))

    @abstractmethod
    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        """The flat buffer for the kernels: `parameters`, then tables, with those of `sample` if
        the light is sampled."""

    def parameters(self, values: Mapping[str, ArrayLike]) -> NDArray[np.float32]:
        """The start of the buffer, in the order of `fields`.

        Parameters
        ----------
        values : mapping    name -> number or numbers

        Raises
        ------
        LightError          names or numbers of values other than `fields` says
        """
        arrays = {name: np.ravel(np.asarray(value, np.float32)) for name, value in values.items()}
        found = {name: len(array) for name, array in arrays.items()}
        if found != dict(self.fields):
            raise LightError(
                f"light {self.kind!r}: its buffer is given {found}, its fields are "
                f"{dict(self.fields)}; give each field as many numbers as it says"
            )
        return np.concatenate([arrays[name] for name, _ in self.fields])
