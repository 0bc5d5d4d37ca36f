"""A convergence run as a figure of a paper: one panel a scene, in the width of a column or page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from furcl.report.convergence_plots import METRICS, draw_errors, legend_columns, save

# Widths of text and of a column in most journals and proceedings.
WIDTHS = {"column": 3.33, "full": 7.0}
PANELS = {"column": 1, "full": 3}
PANEL_HEIGHT = 2.1
LEGEND_ROW = 0.17
LETTER = 0.065  # width of a letter of the legend, on average
PRINT_DPI = 400
# Letters as large as captions.
_SMALL: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.5,
}


def paper_figure(scenes: Sequence[Mapping[str, Any]], metric: str, width: str) -> Figure:
    """Error over render time of every scene.

    Parameters
    ----------
    scenes : list       of results, with one variant or more each
    metric : str        a key of METRICS
    width : str         a key of WIDTHS, which are inches
    """
    columns = min(PANELS[width], len(scenes))
    rows = -(-len(scenes) // columns)
    names = list(dict.fromkeys(v["name"] for scene in scenes for v in scene["variants"]))
    in_row = legend_columns(names, WIDTHS[width], LETTER)
    height = PANEL_HEIGHT * rows + LEGEND_ROW * -(-len(names) // in_row)
    with rc_context(_SMALL):
        figure = Figure(figsize=(WIDTHS[width], height), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel, scene in zip(panels, scenes, strict=False):
            draw_errors(panel, scene, metric)
            panel.set_title(scene["name"], loc="left")
        for panel in panels[len(scenes) :]:
            panel.set_axis_off()
        handles: dict[str, Any] = {}
        for panel in panels:
            lines, labels = panel.get_legend_handles_labels()
            handles = {**dict(zip(labels, lines, strict=True)), **handles}
        figure.legend(
            list(handles.values()), list(handles), loc="outside lower center", ncols=in_row,
            frameon=False, handlelength=2.0, columnspacing=1.0,
        )  # fmt: skip
    return figure


def write_figures(
    scenes: Sequence[Mapping[str, Any]], folder: Path, metrics: Sequence[str] = tuple(METRICS)
) -> list[Path]:
    """Write METRIC-column and METRIC-full as .pdf, .svg and .png to a folder; returns the paths."""
    written = []
    for metric in metrics:
        for width in WIDTHS:
            figure = paper_figure(scenes, metric, width)
            for suffix in (".pdf", ".svg", ".png"):
                written.append(folder / f"{metric}-{width}{suffix}")
                with rc_context(_SMALL):
                    save(figure, written[-1], dpi=PRINT_DPI)
    return written
