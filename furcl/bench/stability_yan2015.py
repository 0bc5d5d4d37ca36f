"""Fibres of Yan et al. 2015 under the stability sweep."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_conditioning import rescaled
from furcl.bench.stability_double_cylinder import (
    DoubleCylinderSubject,
    grid_fibres,
    random_fibre,
    random_profiles,
)
from furcl.bench.stability_subject import Subject
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import MedullaProfiles
from furcl.fibre.yan2015.features import SCATTERED, Yan2015Features
from furcl.fibre.yan2015.model import MODEL
from furcl.fibre.yan2015.parameters import RANGES, Yan2015Fibre
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

ETAS_M = (1.0001, 1.05, 1.2, 1.4999, 1.5, 1.55, 1.8, 3.0)
"""Values of eta_m at the ends of its range and about the cortex's."""


def of_two_indices(fibre: Fibre, eta_m: float) -> Yan2015Fibre:
    """The same fibre with another index of its medulla."""
    values = {field.name: getattr(fibre, field.name) for field in dataclasses.fields(Fibre)}
    return Yan2015Fibre(**values, eta_m=eta_m)


class Yan2015Subject(Subject):
    """Fibres of the double cylinder's sweep with a medulla of another index."""

    def __init__(self) -> None:
        super().__init__(MODEL, Yan2015Fibre)
        self._of_one_index = DoubleCylinderSubject()

    def grid(self) -> Iterator[tuple[str, Any, Yan2015Fibre]]:
        for name, value, fibre in grid_fibres():
            yield name, value, of_two_indices(fibre, 1.2)
        base = next(fibre for name, value, fibre in grid_fibres() if (name, value) == ("eta", 1.33))
        for eta_m in ETAS_M:
            yield "eta_m", eta_m, of_two_indices(base.replace(eta=1.5), eta_m)

    def random(self, rng: np.random.Generator) -> Yan2015Fibre:
        fibre = random_fibre(rng)
        edge = ETAS_M[int(rng.integers(len(ETAS_M)))]
        anywhere = float(rng.uniform(*RANGES["eta_m"]))
        return of_two_indices(fibre, edge if rng.random() < 0.5 else anywhere)

    def edge(self, fibre: Yan2015Fibre, cos: Array) -> Array:
        """Where rays begin to miss the medulla, or to be reflected totally at it."""
        parts = (fibre.cortex, fibre.medulla)
        return np.minimum(*(self._of_one_index.edge(part, cos) for part in parts))

    def neighbours(self, fibre: Yan2015Fibre, way: float) -> list[Yan2015Fibre]:
        """Either offset inside against kappa, and the indices against each other, which rounding
        moves."""
        kappa = float(rescaled(np.array(fibre.kappa), way))
        eta_m = float(rescaled(np.array(fibre.eta_m), way))
        eta = float(rescaled(np.array(fibre.eta), way))
        changes = (
            {"kappa": kappa},
            {"eta_m": min(max(eta_m, 1.0001), 3.0)},
            {"eta": min(max(eta, 1.0001), 3.0)},
        )
        return [dataclasses.replace(fibre, **change) for change in changes]

    def prepared(self, features: Yan2015Features) -> MedullaProfiles:
        return random_profiles(features.profile_channels)

    def direction_factors(self, probe: Probe) -> Array:
        factor = self._of_one_index.scattered_factor(probe)
        return np.array([factor if name in SCATTERED else 1.0 for name in probe.lobes])

    def index(self, fibre: Yan2015Fibre) -> float:
        return fibre.eta


YAN2015_SUBJECT = Yan2015Subject()
