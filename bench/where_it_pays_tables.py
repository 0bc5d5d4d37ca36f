"""The figure and the tables of docs/where_it_pays.md, from the results of bench/where_it_pays.py.

python bench/where_it_pays_tables.py        draws docs/figures/where_it_pays.png
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from tables import FOLDER, Results, circumstances, load, table
from where_it_pays import ABSORPTIONS, LIGHT_SAMPLING, STRANDS, Cell

from furcl.report.convergence_plots import save

RESULTS = "where_it_pays/results.json"
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "where_it_pays.png"
MEASURES = {"path_rmse": "paths", "rmse": "whole picture"}
SAMPLED = {"bcsdf": "no light samples", "mis": "light samples"}
# Ratios from half to double have colours of their own.
RANGE = math.log(2.0)
# An interval wider than from 1/1.5 to 1.5 times its middle says nothing of a cell, nor do pictures
# that lack more than this share of the radiance which light samples find: no path met the sun.
UNKNOWN, LACKING = math.log(1.5), 0.1


def lights(cells: Iterable[Cell]) -> list[tuple[str, float]]:
    """The lights of cells, in their order."""
    return list(dict.fromkeys((cell["light"], cell["angle_deg"]) for cell in cells))


def light_name(light: tuple[str, float]) -> str:
    """As figure and tables say it."""
    return light[0] if light[0] == "even" else f"{light[0]}, {light[1]:g}°"


def verdict(cell: Cell, measure: str, kind: str) -> str:
    """Whether an interval is below 1 ("better"), above ("worse"), around 1 or says nothing."""
    found = cell[kind][measure]
    if found["mean"] is None or math.log(found["high"] / found["low"]) > 2.0 * UNKNOWN:
        return "unknown"
    if min(cell[kind]["radiance"]) < (1.0 - LACKING) * max(cell["mis"]["radiance"]):
        return "unknown"
    if found["high"] < 1.0:
        return "better"
    return "worse" if found["low"] > 1.0 else "same"


def draw(results: Results) -> Figure:
    """A panel for every light (columns), for paths and whole picture, each without and with light
    samples (rows); in a panel absorption to the right, density upwards."""
    cells = results["cells"]
    columns = lights(cells)
    rows = [(measure, kind) for measure in MEASURES for kind in LIGHT_SAMPLING]
    figure = Figure(figsize=(1.35 * len(columns) + 2.2, 1.75 * len(rows) + 1.0))
    panels = figure.subplots(len(rows), len(columns), squeeze=False, sharex=True, sharey=True)
    norm = TwoSlopeNorm(0.0, -RANGE, RANGE)
    shown = None
    for (measure, kind), line in zip(rows, panels, strict=True):
        for light, axes in zip(columns, line, strict=True):
            own = [c for c in cells if (c["light"], c["angle_deg"]) == light]
            shown = _panel(axes, own, measure, kind, norm)
        label = f"{MEASURES[measure]},\n{SAMPLED[kind]}"
        line[0].set_ylabel(f"{label}\n\nstrands", fontsize=8)
    for light, axes in zip(columns, panels[0], strict=True):
        axes.set_title(light_name(light), fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("absorption", fontsize=8)
    figure.subplots_adjust(left=0.1, right=0.92, top=0.93, bottom=0.08, wspace=0.08, hspace=0.08)
    bar = figure.colorbar(shown, cax=figure.add_axes((0.935, 0.2, 0.012, 0.6)))
    ticks = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
    bar.set_ticks(np.log(ticks).tolist(), labels=[f"{t:g}" for t in ticks])
    bar.set_label("RMSE of attenuation-cdf over that of uniform-h", fontsize=8)
    return figure


def _panel(axes: Axes, cells: list[Cell], measure: str, kind: str, norm: TwoSlopeNorm) -> Any:
    values = np.full((len(STRANDS), len(ABSORPTIONS)), np.nan)
    for cell in cells:
        y, x = STRANDS.index(cell["strands"]), ABSORPTIONS.index(cell["sigma_ca"])
        found = cell[kind][measure]
        said = verdict(cell, measure, kind)
        if said != "unknown":
            values[y, x] = math.log(found["mean"])
        text = "?" if said == "unknown" else f"{found['mean']:.2f}".removeprefix("0")
        weight = "bold" if said in ("better", "worse") else "normal"
        axes.text(x, y, text, ha="center", va="center", fontsize=6, fontweight=weight)
    shown = axes.imshow(values, norm=norm, cmap="RdBu_r", origin="lower", aspect="auto")
    axes.set_facecolor("#eeeeee")
    axes.set_xticks(range(len(ABSORPTIONS)), [f"{a:g}" for a in ABSORPTIONS], fontsize=6)
    axes.set_yticks(range(len(STRANDS)), [f"{n:,}" for n in STRANDS], fontsize=6)
    return shown


def counts(results: Results) -> str:
    """Of every light, how many cells are better, worse or neither, for paths; their range."""
    cells = results["cells"]
    lines = []
    for light in lights(cells):
        own = [c for c in cells if (c["light"], c["angle_deg"]) == light]
        line = [light_name(light), f"{len(own)}"]
        for kind in LIGHT_SAMPLING:
            said = [verdict(c, "path_rmse", kind) for c in own]
            sure = [
                c[kind]["path_rmse"]["mean"]
                for c, s in zip(own, said, strict=True)
                if s != "unknown"
            ]
            line.append(
                " / ".join(str(said.count(w)) for w in ("better", "same", "worse", "unknown"))
            )
            line.append(f"{min(sure):.2f} to {max(sure):.2f}" if sure else "-")
        lines.append(line)
    heads = [head for kind in LIGHT_SAMPLING for head in (SAMPLED[kind], "ratios")]
    return table(["light", "cells", *heads], lines)


def _made(make: Callable[[Results], str]) -> Callable[[], str]:
    return lambda: make(load(RESULTS))


TABLES = {
    "pays-circumstances": _made(lambda results: circumstances(results)),
    "pays-counts": _made(counts),
}


if __name__ == "__main__":
    found = load(RESULTS)
    about = {"Description": f"{found['command']}, commit {found['git']}"}
    save(draw(found), FIGURE, dpi=130, metadata=about)
    print(f"wrote {FIGURE.relative_to(FOLDER.parents[1])}")
