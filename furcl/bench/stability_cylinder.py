"""Cylinders without a medulla under the stability sweep."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from furcl.bench.stability_subject import Subject
from furcl.fibre.chiang.model import MODEL as CHIANG
from furcl.fibre.chiang.parameters import RANGES as CHIANG_RANGES
from furcl.fibre.chiang.parameters import ChiangFibre
from furcl.fibre.deon.model import MODEL as DEON
from furcl.fibre.deon.parameters import RANGES as DEON_RANGES
from furcl.fibre.deon.parameters import DEonFibre
from furcl.fibre.model import FibreModel
from furcl.fibre.ranges import Range

_SIGMAS = (0.0, 1e-8, 1.0, 50.0, 1e4, (1e-2, 1.0, 1e4))
_ETAS = (1.0001, 1.001, 1.05, 1.33, 1.55, 3.0)
_ALPHAS = (-20.0, -3.0, 0.0, 1e-4, 20.0)
_BETAS = tuple(math.degrees(b) for b in (1e-3, 3e-3, 0.03, 0.25, 0.41, 1.0, 1.51, 2.5))

# Values of every parameter that lie at the end of its range or where a formula changes.
CHIANG_EDGES: dict[str, Sequence[Any]] = {
    "eta": _ETAS,
    "beta_m": (0.01, 0.03, 0.3, 0.8, 1.0),
    "beta_n": (0.01, 0.03, 0.3, 0.8, 1.0),
    "alpha_deg": _ALPHAS,
    "sigma_a": _SIGMAS,
}
DEON_EDGES: dict[str, Sequence[Any]] = {
    "eta": _ETAS,
    "alpha_deg": _ALPHAS,
    "beta_m_deg": _BETAS,
    "beta_n_deg": _BETAS,
    "sigma_a": _SIGMAS,
    "orders": (3, 4, 8),
    "cone": (False, True),
}
_LOWEST_SIGMA = 1e-8


class CylinderSubject(Subject):
    """Fibres that are a dataclass of numbers.

    Parameters
    ----------
    edges : mapping     parameter -> values at which something is special
    ranges : mapping    parameter -> its range; those without one take an edge always

    Attributes
    ----------
    base : mapping      parameters of the grid's fibres but for the one at an edge
    logarithmic         parameters of three numbers, drawn evenly in their logarithms
    """

    base: Mapping[str, Any] = {"sigma_a": (0.1, 0.3, 0.9)}
    logarithmic: Sequence[str] = ("sigma_a",)

    def __init__(
        self,
        model: FibreModel,
        parameters: type,
        edges: Mapping[str, Sequence[Any]],
        ranges: Mapping[str, Range],
    ) -> None:
        super().__init__(model, parameters)
        self._edges, self._ranges = edges, ranges

    def grid(self) -> Iterator[tuple[str, Any, Any]]:
        for name, values in self._edges.items():
            for value in values:
                yield name, value, self.parameters(**{**self.base, name: value})

    def random(self, rng: np.random.Generator) -> Any:
        values = {}
        for name, edges in self._edges.items():
            if name not in self._ranges or rng.random() < 0.5:
                values[name] = edges[int(rng.integers(len(edges)))]
            elif name in self.logarithmic:
                high = math.log(self._ranges[name][1])
                values[name] = tuple(np.exp(rng.uniform(math.log(_LOWEST_SIGMA), high, 3)))
            else:
                values[name] = float(rng.uniform(*self._ranges[name]))
        return self.parameters(**values)

    def index(self, fibre: Any) -> float:
        return fibre.eta


CHIANG_SUBJECT = CylinderSubject(CHIANG, ChiangFibre, CHIANG_EDGES, CHIANG_RANGES)
DEON_SUBJECT = CylinderSubject(DEON, DEonFibre, DEON_EDGES, DEON_RANGES)
