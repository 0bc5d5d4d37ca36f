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
from matplotlib.cm import ScalarMappable
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from tables import FOLDER, Results, circumstances, load, table
from where_it_pays import ABSORPTIONS, LIGHT_SAMPLING, Cell

from furcl.report.convergence_plots import save

RESULTS = "where_it_pays/results.json"
CLOSE_RESULTS = "where_it_pays/close.json"
PARTS_RESULTS = "variance/results.json"
EVEN_RESULTS = "even_light/results.json"
# Of the table of black hair: its absorption, and the suns shown.
BLACK, SHOWN_SUNS = 4.1, (60.0, 10.0)
PARTS = ("camera", "h", "lobe", "direction", "light", "roulette", "later")
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "where_it_pays.png"
MEASURES = {"path_rmse": "paths", "rmse": "whole picture"}
SAMPLED = {"bcsdf": "no light samples", "mis": "light samples"}
# Ratios from half to double have colours of their own.
RANGE, COLOURS = math.log(2.0), "RdBu_r"
# An interval wider than from 1/1.5 to 1.5 times its middle says nothing of a cell, nor do pictures
# whose radiance is farther than this share from the one that light samples find: paths met the sun
# too rarely.
UNKNOWN, FAR = math.log(1.5), 0.07


def lights(cells: Iterable[Cell]) -> list[tuple[str, float]]:
    """The lights of cells, in their order."""
    return list(dict.fromkeys((cell["light"], cell["angle_deg"]) for cell in cells))


def densities(cells: Iterable[Cell]) -> list[int]:
    """The numbers of strands of cells, ascending."""
    return sorted({cell["strands"] for cell in cells})


def light_name(light: tuple[str, float]) -> str:
    """As figure and tables say it."""
    return light[0] if light[0] == "even" else f"{light[0]}, {light[1]:g}°"


def verdict(cell: Cell, measure: str, kind: str) -> str:
    """Whether an interval is below 1 ("better"), above ("worse"), around 1 or says nothing."""
    found = cell[kind][measure]
    if found["mean"] is None or math.log(found["high"] / found["low"]) > 2.0 * UNKNOWN:
        return "unknown"
    light = np.mean(cell["mis"]["radiance"])
    if np.abs(np.array(cell[kind]["radiance"]) / light - 1.0).max() > FAR:
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
    for (measure, kind), line in zip(rows, panels, strict=True):
        for light, axes in zip(columns, line, strict=True):
            own = [c for c in cells if (c["light"], c["angle_deg"]) == light]
            _panel(axes, own, densities(cells), measure, kind, norm)
        label = f"{MEASURES[measure]},\n{SAMPLED[kind]}"
        line[0].set_ylabel(f"{label}\n\nstrands", fontsize=8)
    for light, axes in zip(columns, panels[0], strict=True):
        axes.set_title(light_name(light), fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("absorption", fontsize=8)
    figure.subplots_adjust(left=0.1, right=0.92, top=0.93, bottom=0.08, wspace=0.08, hspace=0.08)
    colours = ScalarMappable(norm, COLOURS)
    bar = figure.colorbar(colours, cax=figure.add_axes((0.935, 0.2, 0.012, 0.6)))
    ticks = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
    bar.set_ticks(np.log(ticks).tolist(), labels=[f"{t:g}" for t in ticks])
    bar.set_label("RMSE of attenuation-cdf over that of uniform-h", fontsize=8)
    return figure


def _panel(
    axes: Axes, cells: list[Cell], strands: list[int], measure: str, kind: str, norm: TwoSlopeNorm
) -> None:
    values = np.full((len(strands), len(ABSORPTIONS)), np.nan)
    for cell in cells:
        y, x = strands.index(cell["strands"]), ABSORPTIONS.index(cell["sigma_ca"])
        found = cell[kind][measure]
        said = verdict(cell, measure, kind)
        if said != "unknown":
            values[y, x] = math.log(found["mean"])
        text = "?" if said == "unknown" else f"{found['mean']:.2f}".removeprefix("0")
        weight = "bold" if said in ("better", "worse") else "normal"
        dark = said != "unknown" and abs(math.log(found["mean"])) > 0.7 * RANGE
        colour = "white" if dark else "black"
        axes.text(x, y, text, ha="center", va="center", size=6, weight=weight, color=colour)
    axes.imshow(values, norm=norm, cmap=COLOURS, origin="lower", aspect="auto")
    axes.set_facecolor("#eeeeee")
    axes.set_xticks(range(len(ABSORPTIONS)), [f"{a:g}" for a in ABSORPTIONS], fontsize=6)
    axes.set_yticks(range(len(strands)), [f"{n:,}" for n in strands], fontsize=6)


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


def black(results: Results) -> str:
    """Black hair in the lights of all densities: ratios of paths, and hits of a path."""
    cells = [cell for cell in results["cells"] if cell["sigma_ca"] == BLACK]
    columns = [light for light in lights(cells) if light[1] in (0.0, *SHOWN_SUNS)]
    lines = []
    for n in densities(cells):
        own = {(c["light"], c["angle_deg"]): c for c in cells if c["strands"] == n}
        for kind in LIGHT_SAMPLING:
            hits = [rays - 1.0 for rays in own["even", 0.0]["bcsdf"]["rays_per_path"]]
            line = [f"{n:,}", SAMPLED[kind], f"{hits[0]:.2f}, {hits[1] / hits[0]:.2f}"]
            line += [_shown(own.get(light), "path_rmse", kind) for light in columns]
            line.append(_shown(own["even", 0.0], "rmse", kind))
            lines.append(line)
    heads = ["strands", "", "hits, ratio", *map(light_name, columns), "even, whole"]
    return table(heads, lines)


def close(results: Results) -> str:
    """Ratios of paths and of whole pictures by the width of fibres, light and mode."""
    cells = results["cells"]
    modes = list(dict.fromkeys(cell["mode"] for cell in cells))
    lines = []
    for light, width in dict.fromkeys(
        ((cell["light"], cell["angle_deg"]), cell["width_px"]) for cell in cells
    ):
        of_mode = {
            cell["mode"]: cell
            for cell in cells
            if ((cell["light"], cell["angle_deg"]), cell["width_px"]) == (light, width)
        }
        for kind in LIGHT_SAMPLING:
            line = [light_name(light), f"{width:g}", SAMPLED[kind]]
            for measure in MEASURES:
                line += [_shown(of_mode[mode], measure, kind) for mode in modes]
            lines.append(line)
    heads = [f"{mode}, {name}" for name in MEASURES.values() for mode in modes]
    return table(["light", "width [px]", "", *heads], lines)


def _shown(cell: Cell | None, measure: str, kind: str) -> str:
    """A ratio with its interval, bold where that is all on one side of 1."""
    if cell is None:
        return ""
    said, found = verdict(cell, measure, kind), cell[kind][measure]
    if said == "unknown":
        return "?"
    text = f"{found['mean']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"
    return text if said == "same" else f"**{text}**"


def parts(results: Results) -> str:
    """Variance of scenes by the numbers that cause it, in percent of each variant's own."""
    lines = []
    for scene in results["scenes"]:
        for found in scene["variants"]:
            share: dict[str, float] = dict.fromkeys(PARTS, 0.0)
            for part in found["parts"]:
                first = part["bounce"] in (None, 0)
                share[part["kind"] if first else "later"] += part["share"]
            line = [scene["name"], found["name"], f"{found['variance']['mean']:.3g}"]
            line += [f"{100 * max(share[name], 0.0):.0f}" for name in PARTS]
            lines.append([*line, _ratio(found["path_rmse"]), _ratio(found["rmse"])])
    heads = ["scene", "variant", "variance", *(f"{name}, %" for name in PARTS)]
    return table([*heads, "RMSE of paths", "whole RMSE"], lines)


def _ratio(found: dict[str, Any]) -> str:
    return f"{found['mean']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"


def scene_even(results: Results) -> str:
    """Ratios of scenes/black_hair_even.toml at every number of samples, and their rays."""
    [scene] = results["scenes"]
    [found] = scene["comparisons"]
    lines = []
    for same, equal in zip(found["same_spp"], found["equal_time"], strict=True):
        rows = (same["rmse_ratio"], equal["rmse_ratio"], same["efficiency_rays"])
        lines.append([f"{same['spp']}", *map(_ratio, rows)])
    return table(["spp", "equal spp", "equal time", "efficiency by rays"], lines)


def _made(make: Callable[[Results], str], name: str = RESULTS) -> Callable[[], str]:
    return lambda: make(load(name))


TABLES = {
    "pays-circumstances": _made(lambda results: circumstances(*results["runs"])),
    "pays-counts": _made(counts),
    "pays-black": _made(black),
    "pays-close": _made(close, CLOSE_RESULTS),
    "pays-close-circumstances": _made(lambda results: circumstances(results), CLOSE_RESULTS),
    "parts-circumstances": _made(lambda results: circumstances(results), PARTS_RESULTS),
    "parts": _made(parts, PARTS_RESULTS),
    "even-circumstances": _made(lambda results: circumstances(results), EVEN_RESULTS),
    "even": _made(scene_even, EVEN_RESULTS),
}


if __name__ == "__main__":
    found = load(RESULTS)
    commits = ", ".join(dict.fromkeys(run["git"] for run in found["runs"]))
    about = {"Description": f"{found['runs'][0]['command']}, commits {commits}"}
    save(draw(found), FIGURE, dpi=130, metadata=about)
    print(f"wrote {FIGURE.relative_to(FOLDER.parents[1])}")
