"""The page of a stability run and the tables of docs/numerics.md."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from furcl.errors import BenchError
from furcl.files import atomic_path

BEGIN = "<!-- written by `furcl bench stability --numerics`: begin -->"
END = "<!-- end -->"


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
    (folder / "plots" / "parameters.svg").write_text(figure)
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


def _label(value: float | list[float]) -> str:
    return "rgb" if isinstance(value, list) else f"{value:.7g}"


def write_numerics(results: Mapping[str, Any], path: str | Path) -> None:
    """Replace the part of a Markdown file between the marks BEGIN and END by the run's tables.

    Raises
    ------
    BenchError      a file without the marks
    """
    path = Path(path)
    text = path.read_text()
    if BEGIN not in text or END not in text:
        raise BenchError(f"{path}: has no lines {BEGIN!r} and {END!r}; add them where tables go")
    before, rest = text.split(BEGIN, 1)
    after = rest.split(END, 1)[1]
    with atomic_path(path) as temporary:
        temporary.write_text(f"{before}{BEGIN}\n{_tables(results)}{END}{after}")


def _weights(results: Mapping[str, Any]) -> list[str]:
    """Largest weights by lobe and sampler, and by region."""
    found = (
        f"{r['quantity'].replace('sample weight', '').strip(' ()') or 'full-cdf'} {r['lobe']} "
        f"{number(r['max_absolute'])}"
        for r in results["rows"]
        if r["quantity"].startswith("sample weight")
    )
    lines = [
        "",
        f"Largest sample weights, mean of the channels: {', '.join(found)}.",
        "",
        "| eta | \\|theta\\| [deg] | samples | largest weight | over the energy | float64 |",
        "|---|---|--:|--:|--:|--:|",
    ]
    for r in results["weights"]:
        eta, degrees = (f"{r[name][0]:g} to {r[name][1]:g}" for name in ("eta", "degrees"))
        cells = " | ".join(number(r[name]) for name in ("weight", "ratio", "bin_ratio"))
        lines.append(f"| {eta} | {degrees} | {r['samples']:,} | {cells} |")
    return lines


def _tables(results: Mapping[str, Any]) -> str:
    device = results["device"]
    run = (
        f"`{results['command']}`, {results['date']}, commit {results.get('git', 'unknown')}; "
        f"{device['name']}, {device['platform']}, driver {device['driver']}; "
        f"{results['random_points']:,} random points besides the grid."
    )
    head = (
        "| quantity | lobe | points | NaN, inf, < 0 | abs. error | rel. error | within the bars | "
        "1 ulp of the inputs at the worst point | error / allowed |"
    )
    lines = ["", run, "", head, "|---|---|--:|--:|--:|--:|--:|--:|--:|"]
    for r in results["rows"]:
        share = f"{r['within_bars'] / r['points']:.3%}" if r["within_bars"] else ""
        bad = r["nan"] + r["inf"] + r["negative"]
        cells = [r["max_absolute"], r["max_relative"]]
        lines.append(
            f"| {r['quantity']} | {r['lobe']} | {r['points']:,} | {bad} | "
            + " | ".join(number(c) if c else "" for c in cells)
            + f" | {share} | {number(r['conditioning']) if r['conditioning'] else ''} | "
            f"{number(r['excess'])} |"
        )
    lines += _weights(results)
    if results["renders"]:
        lines += [
            "",
            "| scene | largest pixel | nonfinite | energy | p against the host | bias seen |",
            "|---|--:|--:|--:|--:|--:|",
        ]
        lines += [
            f"| {r['scene']} | {number(r['largest'])} | {r['nonfinite']} | "
            f"{number(r['energy'])} | {number(r['p'])} | {number(r['detects'])} |"
            for r in results["renders"]
        ]
    return "\n".join([*lines, "", ""])
