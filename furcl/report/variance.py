"""Figures of `furcl bench variance`: parts as stacked bars, and as maps over the picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from furcl.bench.variance import maps_of
from furcl.report.convergence_plots import STYLES, save

COLOURS = {
    "camera": "#777777",
    **{
        kind: STYLES[i][0] for i, kind in enumerate(("h", "lobe", "direction", "light", "roulette"))
    },
    "later": "#dddddd",
}
LABELS = {"camera": "camera", "h": "offset h", "later": "later bounces"}
# A bounce is so much nearer to white than the one before.
PALER = 0.45
# Of maps: what is shown below the largest value.
DECADES = 3.5
COLUMNS = 4


def colour(kind: str, bounce: int | None) -> tuple[float, float, float]:
    """Of a part: its kind's, paler with every bounce."""
    own = np.array(to_rgb(COLOURS[kind]))
    return tuple(1.0 - (1.0 - own) * (1.0 - PALER) ** (bounce or 0))


def stacked(results: Mapping[str, Any]) -> Figure:
    """A bar for every variant of every scene: its parts over the variance of the scene's first."""
    rows = [
        (f"{scene['name']}, {variant['name']}", scene["variants"][0], variant)
        for scene in results["scenes"]
        for variant in scene["variants"]
    ]
    figure = Figure(figsize=(9.0, 1.3 + 0.42 * len(rows)), layout="constrained")
    axes = figure.subplots()
    for y, (_, first, variant) in enumerate(rows):
        start = 0.0
        for part in variant["parts"]:
            width = max(part["variance"]["mean"], 0.0) / (first["variance"]["mean"] or 1.0)
            axes.barh(
                y, width, left=start, height=0.7, color=colour(part["kind"], part["bounce"]),
                edgecolor="white", linewidth=0.5,
            )  # fmt: skip
            start += width
    axes.set_yticks(range(len(rows)), [name for name, *_ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel(
        "variance of a sample, over that of the scene's first variant; paler: later bounces"
    )
    axes.spines[["top", "right"]].set_visible(False)
    kinds = {part["kind"] for _, _, variant in rows for part in variant["parts"]}
    handles = [Patch(color=c, label=LABELS.get(k, k)) for k, c in COLOURS.items() if k in kinds]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    return figure


def maps(title: str, parts: Mapping[str, NDArray[np.floating]]) -> Figure:
    """A panel for each part, all with one logarithmic scale; what noise made negative is dark."""
    largest = max(float(np.quantile(part, 0.995)) for part in parts.values()) or 1.0
    norm = LogNorm(largest * 10.0**-DECADES, largest, clip=True)
    rows = -(-len(parts) // COLUMNS)
    figure = Figure(figsize=(2.2 * COLUMNS + 1.0, 2.35 * rows + 0.4), layout="constrained")
    panels = np.ravel(figure.subplots(rows, COLUMNS, squeeze=False))
    shown = None
    for axes, (name, part) in zip(panels, parts.items(), strict=False):
        shown = axes.imshow(np.maximum(part, norm.vmin or 0.0), norm=norm, cmap="inferno")
        kind, _, bounce = name.partition(" ")
        label = LABELS.get(kind, kind)
        axes.set_title(f"{label}, bounce {int(bounce) + 1}" if bounce else label, fontsize=9)
    for axes in panels:
        axes.set_axis_off()
    if shown is not None:
        bar = figure.colorbar(shown, ax=list(panels), shrink=0.8, label="variance of a sample")
        bar.formatter = FuncFormatter(lambda value, _: f"{value:g}")
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    return figure


def write_figures(results: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write parts.png, and maps/ as pictures beside their numbers; returns the files."""
    text = {"Description": results["command"], "Software": f"furcl {results['git']}"}
    written = [folder / "parts.png"]
    save(stacked(results), written[0], dpi=130, metadata=text)
    for scene in results["scenes"]:
        for variant in scene["variants"]:
            with np.load(folder / maps_of(scene["name"], variant["name"])) as parts:
                figure = maps(f"{scene['name']}, {variant['name']}", dict(parts))
            path = (folder / maps_of(scene["name"], variant["name"])).with_suffix(".png")
            save(figure, path, dpi=110, metadata=text)
            written.append(path)
    return written
