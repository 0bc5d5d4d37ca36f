"""The figure of the ladder: efficiency of every rung over the baseline, and of the last in all
lights. `python bench/ladder_tables.py` draws it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ladder import FIRST, SHIPPED, SUFFIX
from ladder_tables import MAIN, against, rungs
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from furcl.report.convergence_plots import STYLES, save

BLUE, RED = STYLES[0][0], STYLES[1][0]
TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
MAX_TICKS = 7


def write(found: Mapping[str, Any], path: Path, text: Mapping[str, str]) -> None:
    """Draw the results of `ladder_tables.measured` into a PNG that says `text` of itself."""
    save(draw(found), path, dpi=130, metadata=dict(text))


def draw(found: Mapping[str, Any]) -> Figure:
    """Above a panel a scene in its own light, below one in all lights."""
    results = found[MAIN]
    scenes = [scene["name"] for scene in results["scenes"]]
    names = list(rungs(results))
    tall = (0.9 + 0.27 * len(names), 0.9 + 0.27 * len(found))
    figure = Figure(figsize=(10.0, sum(tall) + 0.5), layout="constrained")
    panels = figure.subplots(2, len(scenes), squeeze=False, sharey="row", height_ratios=tall)
    for column, scene in enumerate(scenes):
        above, below = panels[:, column]
        for suffix, colour, marker, label in (
            ("", BLUE, "o", "uniform-h"),
            (SUFFIX, RED, "s", "attenuation-cdf"),
        ):
            shift = 0.15 if suffix else -0.15
            gains = [_gain(results, scene, name + suffix) for name in names]
            _points(above, gains, shift, colour, marker, label)
        above.set_yticks(range(len(names)), names)
        above.set_title(scene, loc="left", fontsize=10)
        shown = [n for n in ("all", SHIPPED) if n in names]
        for place, name in enumerate(shown):
            gains = [_gain(r, scene, name) for r in found.values()]
            colour, marker = STYLES[2 + place]
            _points(below, gains, 0.3 * place - 0.15, colour, marker, name)
        below.set_yticks(range(len(found)), list(found))
        below.set_xlabel("efficiency over the baseline")
    for row in panels:
        _finish(row)
        row[0].set_ylim(len(row[0].get_yticks()) - 0.5, -0.5)
        row[-1].legend(fontsize=8, loc="best", frameon=False)
    return figure


def _gain(results: Mapping[str, Any], scene: str, name: str) -> Mapping[str, Any] | None:
    if name == FIRST:
        return {"mean": 1.0, "low": 1.0, "high": 1.0}
    found = against(dict(results), scene, name, FIRST)
    return found["efficiency"] if found else None


def _points(
    axes: Axes, gains: list[Any], shift: float, colour: str, marker: str, label: str
) -> None:
    rows = [(y + shift, g["mean"], g["low"], g["high"]) for y, g in enumerate(gains) if g]
    if not rows:
        return
    y, mean, low, high = np.array(rows, np.float64).T
    axes.errorbar(
        mean, y, xerr=[mean - low, high - mean], color=colour, marker=marker, label=label,
        linestyle="none", markersize=4.5, elinewidth=1.1, capsize=2.0,
    )  # fmt: skip


def _finish(row: Sequence[Axes]) -> None:
    """One logarithmic axis for a row, wide enough for its means; intervals may be cut."""
    points = [container.lines[0] for axes in row for container in axes.containers]
    means = np.concatenate([line.get_xdata() for line in points])
    low, high = min(0.5, 0.6 * min(means)), max(2.0, 1.7 * max(means))
    for axes in row:
        axes.axvline(1.0, color="#888", linewidth=0.9)
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        ticks = [t for t in TICKS if low <= t <= high]
        axes.xaxis.set_major_locator(ticker.FixedLocator(ticks[:: -(-len(ticks) // MAX_TICKS)]))
        axes.xaxis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_locator(ticker.NullLocator())
        axes.grid(True, axis="x", linewidth=0.4, alpha=0.4)
        axes.spines[["top", "right"]].set_visible(False)
