"""What a stability sweep finds for one quantity of one lobe, and the point where it is worst."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_points import Points

Array = NDArray[np.float64]

CONDITION_FACTOR = 8.0
"""Errors up to this many times the effect of one unit in the last place of the inputs are the
inputs' own, not the formulas'."""


@dataclass
class Row:
    """What was found for one quantity of one lobe.

    `excess` is the largest error over its allowance: the larger of the two bars, plus
    CONDITION_FACTOR times the conditioning of the point. At that worst point stand `value`,
    `reference` and `conditioning`, the change of the reference when an input changes by one unit
    in the last place of float32.
    """

    quantity: str
    lobe: str
    points: int = 0
    nan: int = 0
    inf: int = 0
    negative: int = 0
    max_absolute: float = 0.0
    max_relative: float = 0.0
    within_bars: int = 0
    excess: float = 0.0
    value: float = 0.0
    reference: float = 0.0
    conditioning: float = 0.0
    worst: dict[str, Any] = field(default_factory=dict)

    def count(self, values: Array) -> None:
        """Count what is not finite or negative."""
        self.points += len(values)
        self.nan += int(np.isnan(values).any(axis=-1).sum())
        self.inf += int(np.isinf(values).any(axis=-1).sum())
        self.negative += int((values < 0.0).any(axis=-1).sum())

    def merge(self, other: Row) -> None:
        """Add what another run found for the same quantity and lobe."""
        for name in ("points", "nan", "inf", "negative", "within_bars"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name in ("max_absolute", "max_relative"):
            setattr(self, name, max(getattr(self, name), getattr(other, name)))
        if not self.worst or (other.excess, other.value) > (self.excess, self.value):
            for name in ("excess", "value", "reference", "conditioning", "worst"):
                setattr(self, name, getattr(other, name))


def describe(fibre: Any, points: Points, i: int) -> dict[str, Any]:
    """All that `furcl bench replay` needs to compute a point again."""
    values = {
        field.name: getattr(fibre, field.name)
        for field in dataclasses.fields(fibre)
        if field.compare
    }
    return {
        "model": fibre.model,
        "fibre": values,
        "sin_cos": points.sin_cos[i].tolist(),
        "h": float(points.h[i]),
        "wo": points.wo[i].tolist(),
        "wi": points.wi[i].tolist(),
    }


def replay_command(worst: dict[str, Any]) -> str:
    """The command line that prints a point again."""
    return f"furcl bench replay '{json.dumps(worst)}'" if "h" in worst else ""
