"""The page of a stability run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def write_report(folder: str | Path) -> Path:
    """Write index.html and plots/parameters.svg beside the results.json of a stability run.

    Raises
    ------
    BenchError      no results.json, or one of another kind
    """
    from furcl.report.page import load_results, write_page

    folder = Path(folder)
    results = load_results(folder, "stability")
    figure = _draw(results["parameters"])
    (folder / "plots").mkdir(exist_ok=True)
    (folder / "plots" / "parameters.svg").write_text(figure, encoding="utf-8")
    return write_page(
        folder,
        "stability.html",
        {"number": number},
        results=results,
        figure=figure,
    )


def number(value: float) -> str:
    """Three digits; nothing for zero."""
    return f"{value:.3g}" if value else "0"


def _draw(parameters: list[Mapping[str, Any]]) -> str:
    """Largest error over what is allowed, for every edge of every parameter, as SVG text."""
    import io

    import matplotlib as mpl
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(p["parameter"] for p in parameters))
    figure = Figure(figsize=(11, 5.5), layout="constrained")
    axes = figure.subplots(2, -(-len(names) // 2), sharey=True).ravel()
    for ax, name in zip(axes, names, strict=False):
        mine = [p for p in parameters if p["parameter"] == name]
        values = list(dict.fromkeys(_label(p["value"]) for p in mine))
        for quantity, colour in (("attenuation", "#0072b2"), ("evaluate", "#d55e00")):
            worst = [
                max(p["excess"][quantity] for p in mine if _label(p["value"]) == value)
                for value in values
            ]
            ax.plot(range(len(values)), worst, "o-", ms=4, lw=1, color=colour, label=quantity)
        ax.axhline(1.0, color="#888", lw=0.8)
        ax.set_yscale("log")
        ax.set_xticks(range(len(values)), values, rotation=60, ha="right", fontsize=7)
        ax.set_title(name, fontsize=9)
    for ax in axes[len(names) :]:
        ax.remove()
    axes[0].set_ylabel("error / allowed")
    axes[0].legend(fontsize=7)
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "furcl"}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]


def _label(value: float | str | bool | list[float]) -> str:
    """A parameter's value as a tick: all colours as one, numbers shortened, the rest as it is."""
    if isinstance(value, list):
        return "rgb"
    return str(value) if isinstance(value, str | bool) else f"{value:.7g}"
