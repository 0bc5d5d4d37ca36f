"""What a stability sweep has found so far, over all of its steps."""

from __future__ import annotations

from typing import Any

from furcl.bench.stability_compare import BARS
from furcl.bench.stability_row import Row
from furcl.bench.stability_steps import Found, Step
from furcl.bench.stability_weights import no_regions


class Total:
    """Collects what steps found; in their order, since of equal errors the first is kept.

    Attributes
    ----------
    rows : dict             (quantity, lobe) -> Row
    regions : list          Region each
    parameters : list       of each fibre of the grid: parameter, value, largest excess by quantity
                            and largest sample weight
    renders : list          of each stiff scene what `render_row` gives
    """

    def __init__(self) -> None:
        self.rows: dict[tuple[str, str], Row] = {}
        self.regions = no_regions()
        self.parameters: list[dict[str, Any]] = []
        self.renders: list[dict[str, Any]] = []

    def add(self, step: Step, found: Found) -> None:
        """Add what a step found."""
        if step.edge is not None:
            self.parameters.append(_at_an_edge(*step.edge, found.rows))
        if found.render is not None:
            self.renders.append(found.render)
        for row in found.rows:
            mine = self.rows.setdefault((row.quantity, row.lobe), Row(row.quantity, row.lobe))
            mine.merge(row)
        for mine, other in zip(self.regions, found.regions, strict=False):
            mine.merge(other)


def _at_an_edge(name: str, value: Any, rows: list[Row]) -> dict[str, Any]:
    return {
        "parameter": name,
        "value": value,
        "excess": {
            quantity: max(row.excess for row in rows if row.quantity == quantity)
            for quantity in BARS
        },
        # Black fibres are never sampled.
        "weight": max(
            (row.max_absolute for row in rows if row.quantity == "sample weight"), default=0.0
        ),
    }
