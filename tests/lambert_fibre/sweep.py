"""The Lambertian fibre under `furcl.bench.stability`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from furcl.bench.stability_subject import Subject
from lambert_fibre import MODEL, LambertFibre

EDGES: dict[str, tuple] = {
    "albedo": ((0.0,) * 3, (1e-8,) * 3, (1e-3, 0.5, 1.0), (1.0,) * 3),
    "rim": (0.0, 1e-8, 0.5, 1.0),
}


class LambertSubject(Subject):
    """Its fibres; nothing is special about them."""

    def grid(self) -> Iterator[tuple[str, Any, LambertFibre]]:
        for name, values in EDGES.items():
            for value in values:
                base: dict[str, Any] = {"albedo": (0.9, 0.5, 0.2), "rim": 0.3, name: value}
                yield name, value, LambertFibre(**base)

    def random(self, rng: np.random.Generator) -> LambertFibre:
        red, green, blue, rim = rng.random(4)
        edges = {name: values[rng.integers(len(values))] for name, values in EDGES.items()}
        albedo = (red, green, blue) if rng.random() < 0.5 else edges["albedo"]
        return LambertFibre(albedo, rim if rng.random() < 0.5 else edges["rim"])


SUBJECT = LambertSubject(MODEL, LambertFibre)
