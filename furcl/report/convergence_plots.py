"""Figures of a convergence run: error over time, and crops with their errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context, ticker
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from furcl.files import atomic_path
from furcl.image.colour import srgb_encode
from furcl.image.image import Image

# Okabe and Ito's colours, told apart by all; markers for print.
STYLES = (
    ("#0072B2", "o"),
    ("#D55E00", "s"),
    ("#009E73", "^"),
    ("#CC79A7", "D"),
    ("#E69F00", "v"),
    ("#56B4E9", "P"),
)
#: Fonts of PDF as TrueType (42), which publishers ask for, and letters of SVG as text.
FOR_PRINT: dict[Any, Any] = {"pdf.fonttype": 42, "ps.fonttype": 42, "svg.fonttype": "none"}
GROUP_WIDTH = 0.8  # of a number of samples, whose distance is 1
LOG_BELOW = 0.5  # ratios are on a logarithmic axis where one is smaller
LINES = ("-", "--", ":", "-.")
LEGEND_COLUMNS = 5
CROP_SHARE = 4  # a crop is a quarter of the picture wide
ERROR_QUANTILE = 0.99
MAX_TICKS = 7
LONGEST_BAR = 100.0


def style_of(index: int) -> dict[str, Any]:
    """Colour, marker and line of the variant of that index; lines change after the last colour."""
    colour, marker = STYLES[index % len(STYLES)]
    return {
        "color": colour,
        "marker": marker,
        "linestyle": LINES[index // len(STYLES) % len(LINES)],
    }


def save(figure: Figure, path: Path, **options: Any) -> None:
    """Write a figure whole or not at all; letters stay letters (FOR_PRINT)."""
    FigureCanvasAgg(figure)
    for text in figure.findobj(Text):
        text.set_parse_math(False)  # names of scenes may hold a $
    with atomic_path(path) as temporary, rc_context(FOR_PRINT):
        figure.savefig(temporary, format=path.suffix[1:], **options)


def error_over_time(scene: Mapping[str, Any]) -> Figure:
    """RMSE over render time, and the ratio at equal time to the baseline.

    Curves have 95 % bands if there are few.
    """
    rows = -(-len(scene["variants"]) // LEGEND_COLUMNS)
    figure = Figure(figsize=(9.0, 3.7 + 0.2 * rows), layout="constrained")
    curves, ratios = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    curves.set(xscale="log", yscale="log", xlabel="render time [s]", ylabel="RMSE")
    for index, variant in enumerate(scene["variants"]):
        _draw_curve(curves, variant, style_of(index), band=len(scene["variants"]) <= len(STYLES))
    for axis in (curves.xaxis, curves.yaxis):
        _plain_log_ticks(axis)
    curves.set_title(f"{scene['name']}: error over time", loc="left", fontsize=10)
    _draw_ratios(ratios, scene)
    for axes in (curves, ratios):
        axes.grid(True, which="both", linewidth=0.4, alpha=0.35)
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = curves.get_legend_handles_labels()
    columns = min(len(labels), LEGEND_COLUMNS) or 1
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def _draw_curve(
    axes: Axes, variant: Mapping[str, Any], style: Mapping[str, Any], *, band: bool
) -> None:
    cells = variant["spp"]
    if not cells:
        return
    seconds, fast, slow = _ends(cell["seconds"] for cell in cells)
    rmse, low, high = _ends(cell["rmse"] for cell in cells)
    if band:
        axes.fill_between(
            seconds, np.maximum(low, 0.5 * rmse), high, color=style["color"], alpha=0.2, linewidth=0
        )
    axes.errorbar(
        seconds, rmse, xerr=[seconds - np.maximum(fast, 0.5 * seconds), slow - seconds], **style,
        markersize=4, linewidth=1.4, elinewidth=0.8, label=variant["name"],
    )  # fmt: skip


def _ends(estimates: Iterable[Mapping[str, Any]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, lower and upper ends; the mean where there is no interval, NaN where there is no mean.

    Of two runs an interval can be as wide as float64: ends are drawn up to LONGEST_BAR times away.
    """
    rows = [(e["mean"], e["low"], e["high"]) for e in estimates]
    mean, low, high = np.array(rows, np.float64).T
    mean[~np.isfinite(mean)] = np.nan
    low, high = np.where(np.isnan(low), mean, low), np.where(np.isnan(high), mean, high)
    return mean, np.maximum(low, mean / LONGEST_BAR), np.minimum(high, mean * LONGEST_BAR)


def _draw_ratios(axes: Axes, scene: Mapping[str, Any]) -> None:
    """Ratio of RMSE at equal time, one group of points for each sample count."""
    names = [variant["name"] for variant in scene["variants"]]
    comparisons = scene["comparisons"]
    baseline = comparisons[0]["baseline"] if comparisons else names[0]
    axes.axhline(1.0, color=style_of(names.index(baseline))["color"], linewidth=1.2)
    step = min(0.16, GROUP_WIDTH / max(len(comparisons), 1))
    counts: list[int] = []
    for place, comparison in enumerate(comparisons):
        rows = comparison["equal_time"]
        counts = [row["spp"] for row in rows]
        x = np.arange(len(rows)) + step * (place - 0.5 * (len(comparisons) - 1))
        mean, low, high = _ends(row["rmse_ratio"] for row in rows)
        style = {**style_of(names.index(comparison["variant"])), "linestyle": "none"}
        axes.errorbar(
            x, mean, yerr=[mean - low, high - mean], **style, markersize=4, capsize=2.0,
            label=comparison["variant"],
        )  # fmt: skip
    axes.set_xticks(range(len(counts)), [f"{n} spp" for n in counts])
    axes.set_xlim(-0.6, max(len(counts) - 0.4, 0.6))
    found = [row["rmse_ratio"]["mean"] for c in comparisons for row in c["equal_time"]]
    if any(mean is not None and 0.0 < mean < LOG_BELOW for mean in found):
        axes.set_yscale("log")
        _plain_log_ticks(axes.yaxis)
    axes.set_title(f"RMSE at equal time over that of {baseline}", loc="left", fontsize=10)


def _plain_log_ticks(axis: Any) -> None:
    """Ticks at round numbers, five or six at most, written as plain numbers."""
    low, high = axis.get_view_interval()
    if not 0.0 < low < high < np.inf:  # nothing that a logarithm shows is drawn
        return
    exponents = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for steps in ((1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8), (1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1,)):
        ticks = [s * 10.0**e for e in exponents for s in steps if low <= s * 10.0**e <= high]
        if len(ticks) <= MAX_TICKS:
            break
    axis.set_major_locator(ticker.FixedLocator(ticks))
    axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(ticker.NullLocator())


def crop_window(variance: np.ndarray) -> tuple[int, int, int, int]:
    """(row, column, height, width) of the quarter of the picture where the variance is largest."""
    total = np.cumsum(np.cumsum(np.pad(variance.sum(axis=2), ((1, 0), (1, 0))), axis=0), axis=1)
    height, width = (max(size // CROP_SHARE, min(size, 8)) for size in variance.shape[:2])
    sums = (
        total[height:, width:] - total[:-height, width:] - total[height:, :-width]
        + total[:-height, :-width]
    )  # fmt: skip
    row, column = np.unravel_index(int(np.argmax(sums)), sums.shape)
    return int(row), int(column), height, width


def crops(
    scene: Mapping[str, Any], spp: int, reference: Image, pictures: Sequence[tuple[str, Image]]
) -> Figure:
    """The picture, and of one crop: reference, some variants, and their absolute errors."""
    stops = scene["document"]["film"]["exposure_stops"]
    assert reference.variance is not None
    row, column, height, width = crop_window(reference.variance.astype(np.float64))
    part = np.s_[row : row + height, column : column + width]
    columns = 2 + len(pictures)
    figure = Figure(figsize=(2.3 * columns, 4.9), layout="constrained")
    axes = figure.subplots(2, columns, squeeze=False)
    for place in axes.ravel():
        place.set_axis_off()
    axes[0, 0].imshow(_displayed(reference.rgb, stops), interpolation="antialiased")
    axes[0, 0].add_patch(
        Rectangle(
            (column - 0.5, row - 0.5), width, height, fill=False, color="#E00000", linewidth=1.5
        )
    )
    axes[0, 0].set_title(scene["name"], fontsize=10)
    axes[0, 1].imshow(_displayed(reference.rgb[part], stops), interpolation="nearest")
    axes[0, 1].set_title(f"reference\n{scene['reference']['spp']} spp", fontsize=10)
    errors = [np.abs(image.rgb[part] - reference.rgb[part]).mean(axis=2) for _, image in pictures]
    top = max(float(np.quantile(errors[0], ERROR_QUANTILE)), 1e-12) if errors else 1.0
    shown = None
    for place, (name, image) in enumerate(pictures, 2):
        axes[0, place].imshow(_displayed(image.rgb[part], stops), interpolation="nearest")
        axes[0, place].set_title(f"{name}\n{spp} spp", fontsize=10)
        shown = axes[1, place].imshow(
            errors[place - 2], cmap="inferno", vmin=0.0, vmax=top, interpolation="nearest"
        )
        axes[1, place].set_title(f"mean error {errors[place - 2].mean():.4g}", fontsize=9)
    if shown is not None:
        bar = figure.colorbar(shown, ax=axes[1, 1], location="left", fraction=0.5, shrink=0.9)
        bar.set_label("absolute error of radiance", fontsize=9)
    return figure


def _displayed(rgb: np.ndarray, stops: float) -> np.ndarray:
    """sRGB values to show, as the PNG files have them."""
    return np.asarray(srgb_encode(np.clip(rgb.astype(np.float64) * 2.0**stops, 0.0, 1.0)))
