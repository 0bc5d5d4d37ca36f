"""The page of a convergence run: plots, crops and tables in one HTML file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from furcl.errors import BenchError
from furcl.files import file_name
from furcl.image.denoise import refuse_denoised
from furcl.image.image import Image
from furcl.report import convergence_plots as plots
from furcl.report.convergence_checks import departures
from furcl.report.convergence_figure import write_figures
from furcl.report.convergence_latex import write_latex
from furcl.report.convergence_schema import upgraded
from furcl.report.page import load_results, write_page

MAX_CROPS = 6
CROP_SPP = 256  # as the paper's crops, or the largest number below that was rendered
_MIME = {".svg": "image/svg+xml", ".png": "image/png"}


def write_report(
    folder: str | Path, *, metrics: Sequence[str] = ("rmse",), scenes: Sequence[str] = ()
) -> Path:
    """Write index.html and plots/ beside the results.json of a convergence run.

    In plots/ are figures and a LaTeX table for papers as well.

    Parameters
    ----------
    folder : path
    metrics : list of str   keys of METRICS: what figures show, the page the first of them
    scenes : list of str    names of the scenes in figures and table for papers; left out: all

    Returns
    -------
    Path        of the page, which needs no other file

    Raises
    ------
    BenchError      no results.json, or one of another kind; a metric or scene that is not there
    """
    folder = Path(folder)
    results = upgraded(load_results(folder, "convergence"))
    chosen_scenes = _chosen_scenes(results, metrics, scenes)
    (folder / "plots").mkdir(exist_ok=True)
    figures = {scene["name"]: _draw(scene, folder, metrics[0]) for scene in results["scenes"]}
    marked = departures(results)
    if chosen_scenes:
        write_figures(chosen_scenes, folder / "plots", metrics)
    write_latex(chosen_scenes, marked, folder / "plots" / "table.tex")
    return write_page(
        folder,
        "convergence.html",
        {
            "interval": interval,
            "plus_minus": plus_minus,
            "verdict": verdict,
            "number": number,
            "data_uri": data_uri,
            "share": share,
            "chosen": chosen,
            "settings": settings,
            "median": median,
            "skewed": skewed,
        },
        results=results,
        figures=figures,
        marked=marked,
    )


def _chosen_scenes(
    results: Mapping[str, Any], metrics: Sequence[str], names: Sequence[str]
) -> list[Mapping[str, Any]]:
    """The scenes of some names that have renders; BenchError for what is not there."""
    for what, asked, there in (
        ("metric", metrics or [""], list(plots.METRICS)),
        ("scene", names, [scene["name"] for scene in results["scenes"]]),
    ):
        for name in asked:
            if name not in there:
                raise BenchError(
                    f"{what} {name!r}: not in the results; allowed are {', '.join(there)}"
                )
    return [
        scene
        for scene in results["scenes"]
        if (scene["name"] in names or not names) and any(v["spp"] for v in scene["variants"])
    ]


def _draw(scene: Mapping[str, Any], folder: Path, metric: str) -> dict[str, Path]:
    """Files of the figures of a scene, by name."""
    drawn, own = {}, file_name(scene["name"])
    figure = plots.error_over_time(scene, metric)
    for suffix in (".svg", ".png", ".pdf"):
        path = folder / "plots" / f"{own}-{metric}{suffix}"
        plots.save(figure, path, dpi=150)
    drawn["error"] = folder / "plots" / f"{own}-{metric}.svg"
    reference = folder / "images" / f"{own}-reference.exr"
    counts = [cell["spp"] for cell in scene["variants"][0]["spp"]]
    spp = max((n for n in counts if n <= CROP_SPP), default=max(counts, default=0))
    pictures = []
    for name in _shown(scene):
        path = folder / "images" / f"{own}-{file_name(name)}-{spp}.exr"
        if path.exists():
            pictures.append((name, _rendered(path)))
    if reference.exists() and pictures:
        figure = plots.crops(scene, spp, _rendered(reference), pictures)
        drawn["crops"] = folder / "plots" / f"{own}-crops.png"
        plots.save(figure, drawn["crops"], dpi=130)
    return drawn


def _rendered(path: Path) -> Image:
    """A picture that is not denoised."""
    image = Image.load(path)
    refuse_denoised(image, str(path), "run the benchmark again", BenchError)
    return image


def _shown(scene: Mapping[str, Any]) -> list[str]:
    """Names of the variants whose crops are shown: all, or the baseline and the most efficient."""
    names = [variant["name"] for variant in scene["variants"]]
    if len(names) <= MAX_CROPS or not scene["comparisons"]:
        return names[:MAX_CROPS]
    best = sorted(scene["comparisons"], key=lambda found: -found["efficiency"]["mean"])
    shown = {best[0]["baseline"], *(found["variant"] for found in best[: MAX_CROPS - 1])}
    return [name for name in names if name in shown]


def chosen(found: Mapping[str, str]) -> str:
    """What "auto" became, as key = value."""
    return ", ".join(f"{key} = {value}" for key, value in found.items()) or "-"


def settings(names: list[str]) -> str:
    """Settings of a variant without the table [render], which most are of."""
    return " ".join(name.removeprefix("render.") for name in names) or "the scene's"


def number(value: float | None, digits: int = 3) -> str:
    """A number with that many significant digits; zeros at the end are digits too."""
    if value is None:
        return "-"
    if isinstance(value, int) or abs(value) >= 10**digits:
        return f"{value:.0f}"
    return f"{value:#.{digits}g}".rstrip(".")


def interval(estimate: Mapping[str, Any] | None, digits: int = 3) -> str:
    """An estimate as "mean [low, high]"."""
    if estimate is None:
        return "-"
    mean = number(estimate["mean"], digits)
    if estimate["low"] is None:
        return mean
    return f"{mean} [{number(estimate['low'], digits)}, {number(estimate['high'], digits)}]"


def plus_minus(estimate: Mapping[str, Any], digits: int = 3) -> str:
    """An estimate as "mean ± half of the interval"."""
    mean = number(estimate["mean"], digits)
    if estimate["low"] is None:
        return mean
    return f"{mean} ± {number(0.5 * (estimate['high'] - estimate['low']), 2)}"


def verdict(estimate: Mapping[str, Any] | None, less_is_better: bool = True) -> str:
    """Whether the interval of a ratio lies on one side of 1: better, worse or even."""
    if estimate is None or estimate["low"] is None:
        return "even"
    low, high = estimate["low"], estimate["high"]
    if low <= 1.0 <= high:
        return "even"
    return "better" if (high < 1.0) == less_is_better else "worse"


def median(estimate: Mapping[str, Any] | None, digits: int = 3) -> str:
    """The median of the runs; a dash in results that do not tell it."""
    return number((estimate or {}).get("median"), digits)


def skewed(scene: Mapping[str, Any]) -> list[str]:
    """Variants whose mean RMSE is far above the median of the runs at some number of samples."""
    return [
        variant["name"]
        for variant in scene["variants"]
        if any(
            plots.median_of(cell["rmse"]) < plots.MEDIAN_BELOW * cell["rmse"]["mean"]
            for cell in variant["spp"]
        )
    ]


def share(value: float) -> str:
    """A share as a percentage with three digits, zeros as 0."""
    return f"{100.0 * value:.3g} %"


def data_uri(path: Path) -> str:
    """A file as the address of an image that needs no file."""
    content = base64.b64encode(path.read_bytes()).decode()
    return f"data:{_MIME[path.suffix]};base64,{content}"
