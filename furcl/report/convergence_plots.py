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
#: Measures of error: what axes call them, and the power of time with which those of independent
#: samples fall; that of FLIP is not known.
METRICS: dict[str, tuple[str, float | None]] = {
    "rmse": ("RMSE", -0.5),
    "relmse": ("relMSE", -1.0),
    "flip": ("FLIP", None),
}
MEDIAN_BELOW = 0.9
GUIDE_ABOVE = 1.25
GROUP_WIDTH = 0.8  # of a number of samples, whose distance is 1
LOG_BELOW = 0.5  # ratios are on a logarithmic axis where one is smaller
LINES = ("-", "--", ":", "-.")
PAGE_WIDTH = 9.0  # of a figure of the page [in]
LETTER = 0.09  # width of a letter of its legend, on average [in]
LEGEND_HANDLE = 0.55  # the line beside a name, and gaps [in]
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


def error_over_time(scene: Mapping[str, Any], metric: str = "rmse") -> Figure:
    """An error (`METRICS`) over render time, and the ratio of RMSE at equal time to the baseline.

    Curves have 95 % bands if there are few.
    """
    names = [variant["name"] for variant in scene["variants"]]
    columns = legend_columns(names, PAGE_WIDTH, LETTER)
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(PAGE_WIDTH, 3.7 + 0.22 * rows), layout="constrained")
    curves, ratios = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    draw_errors(curves, scene, metric)
    curves.set_title(f"{scene['name']}: error over time", loc="left", fontsize=10)
    _draw_ratios(ratios, scene)
    for axes in (curves, ratios):
        _light_grid(axes)
    handles, labels = curves.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def legend_columns(names: Sequence[str], width: float, letter: float) -> int:
    """How many names stand beside each other in a width, each letter so wide [in]."""
    each = LEGEND_HANDLE + letter * max(map(len, names), default=0)
    return max(1, min(len(names), int(width / each)))


def draw_errors(axes: Axes, scene: Mapping[str, Any], metric: str) -> None:
    """Curves of all variants on logarithmic axes, with a guide of the slope of independent samples.

    A hollow marker is the median of the runs, where it is less than MEDIAN_BELOW of the mean.
    """
    label, slope = METRICS[metric]
    variants = scene["variants"]
    axes.set(xscale="log", yscale="log", xlabel="render time [s]", ylabel=label)
    for index, variant in enumerate(variants):
        _draw_curve(axes, variant, style_of(index), metric, band=len(variants) <= len(STYLES))
    if slope is not None:
        _draw_guide(axes, variants, metric, slope)
    for axis in (axes.xaxis, axes.yaxis):
        plain_log_ticks(axis)
    _light_grid(axes)


def _light_grid(axes: Axes) -> None:
    axes.grid(True, which="both", linewidth=0.4, alpha=0.35)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_curve(
    axes: Axes, variant: Mapping[str, Any], style: Mapping[str, Any], metric: str, *, band: bool
) -> None:
    cells = variant["spp"]
    if not cells:
        return
    seconds, fast, slow = _ends(cell["seconds"] for cell in cells)
    error, low, high = _ends(cell[metric] for cell in cells)
    error[~(error > 0.0)] = np.nan  # below the reference's own: nothing that a logarithm shows
    if band:
        low = np.maximum(low, 0.5 * error)
        axes.fill_between(seconds, low, high, color=style["color"], alpha=0.2, linewidth=0)
    axes.errorbar(
        seconds, error, xerr=[seconds - np.maximum(fast, 0.5 * seconds), slow - seconds], **style,
        markersize=4, linewidth=1.4, elinewidth=0.8, label=variant["name"],
    )  # fmt: skip
    median = np.array([median_of(cell[metric]) for cell in cells])
    apart = median < MEDIAN_BELOW * error
    axes.plot(
        seconds[apart], median[apart], **{**style, "linestyle": "none"}, markersize=7,
        markerfacecolor="none", zorder=5,
    )  # fmt: skip


def _draw_guide(
    axes: Axes, variants: Sequence[Mapping[str, Any]], metric: str, slope: float
) -> None:
    """A dotted line above all curves, from the first to the last of their times."""
    points = [
        (cell["seconds"]["mean"], cell[metric]["mean"])
        for variant in variants
        for cell in variant["spp"]
        if cell["seconds"]["mean"] and (cell[metric]["mean"] or 0.0) > 0.0
    ]
    if len(points) < 2:
        return
    time, error = np.array(points).T
    ends = np.array([time.min(), time.max()])
    height = GUIDE_ABOVE * float(np.max(error * (time / ends[0]) ** -slope))
    axes.plot(ends, height * (ends / ends[0]) ** slope, ":", color="#666666", linewidth=1.0)
    axes.annotate(
        f"slope {slope:g}".replace("-", "\N{MINUS SIGN}"),
        (ends.prod() ** 0.5, height * (ends.prod() ** 0.5 / ends[0]) ** slope),
        (3, 2),
        textcoords="offset points",
        color="#666666",
        fontsize="small",
    )


def median_of(estimate: Mapping[str, Any]) -> float:
    """The median of the runs, NaN in results of versions that did not tell it."""
    found = estimate.get("median")
    return np.nan if found is None else found


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
        plain_log_ticks(axes.yaxis)
    axes.set_title(f"RMSE at equal time over that of {baseline}", loc="left", fontsize=10)


def plain_log_ticks(axis: Any) -> None:
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
