"""What the stability sweep asks of a fibre model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_points import Points, points
from furcl.device.choice import Device
from furcl.fibre.model import FibreModel
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]


class Subject:
    """A fibre model under the sweep; subclasses give its fibres and what is special about it.

    Parameters
    ----------
    model : FibreModel
    parameters : type       the class of its fibres, a dataclass
    """

    weight_bars: Mapping[str, float] = {}
    """By lobe, how much 0.5 evaluate / pdf may differ from the weight that a sample says, relative;
    else 1e-4."""

    def __init__(self, model: FibreModel, parameters: type) -> None:
        self.model, self.parameters = model, parameters

    def grid(self) -> Iterator[tuple[str, Any, Any]]:
        """Ordinary fibres with one parameter at an edge: its name, its value, the fibre."""
        raise NotImplementedError

    def random(self, rng: np.random.Generator) -> Any:
        """A fibre with every parameter at an edge or anywhere, with equal chance."""
        raise NotImplementedError

    def edge(self, fibre: Any, cos: Array) -> Array:
        """(n,) offsets at which the attenuation has an edge, by the cosine of the inclination;
        above 1 there is none."""
        return np.full_like(cos, np.inf)

    def neighbours(self, fibre: Any, way: float) -> list[Any]:
        """Fibres that rounding to float32 may make of this one, up (way 1) or down (-1), where that
        matters more than its rounding of offset and directions."""
        return []

    def prepared(self, features: Any) -> Any:
        """What stands for what the model prepares; both sides read it."""
        return None

    def direction_factors(self, probe: Probe) -> Array:
        """(lobes,) value over density of a lobe's directions, over its energy, at most."""
        return np.ones(len(probe.lobes))

    def most_energy(self, fibre: Any) -> float:
        """What the attenuations of all lobes add up to at most."""
        return 1.0

    def index(self, fibre: Any) -> float:
        """Refractive index, for the regions of the largest weights."""
        return 1.5

    def points(self, fibre: Any, rng: np.random.Generator, n: int) -> Points:
        """Random points to look at a fibre."""
        return points(lambda cos: self.edge(fibre, cos), rng, n)

    def probe(
        self,
        fibre: Any,
        device: str | Device | None,
        sampling: str = "full-cdf",
        specialised: bool = True,
    ) -> Probe:
        """A probe in three channels with all lobes, and with what `prepared` gives.

        Specialised, its kernels have what the fibre needs, as those of a render do; else
        everything, so that all fibres share one build.
        """
        features = self.model.features(fibre, residual=True)
        if not specialised:
            features = features.everything_on()
        profiles = self.prepared(features)
        return Probe(fibre, sampling, device, channels=3, features=features, profiles=profiles)
