"""The page of a convergence run: plots, crops and tables in one HTML file."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from furcl.files import file_name
from furcl.image.image import Image
from furcl.report import convergence_plots as plots
from furcl.report.convergence_checks import departures
from furcl.report.convergence_schema import upgraded
from furcl.report.page import load_results, write_page

MAX_CROPS = 6
CROP_SPP = 256  # as the paper's crops, or the largest number below that was rendered
_MIME = {".svg": "image/svg+xml", ".png": "image/png"}


def write_report(folder: str | Path) -> Path:
    """Write plots/ and index.html beside the results.json of a convergence run.

    Returns
    -------
    Path        of the page, which needs no other file

    Raises
    ------
    BenchError      no results.json, or one of another kind
    """
    folder = Path(folder)
    results = upgraded(load_results(folder, "convergence"))
    (folder / "plots").mkdir(exist_ok=True)
    figures = {scene["name"]: _draw(scene, folder) for scene in results["scenes"]}
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
        },
        results=results,
        figures=figures,
        marked=departures(results),
    )


def _draw(scene: Mapping[str, Any], folder: Path) -> dict[str, Path]:
    """Files of the figures of a scene, by name."""
    drawn, own = {}, file_name(scene["name"])
    figure = plots.error_over_time(scene)
    for suffix in (".svg", ".png", ".pdf"):
        path = folder / "plots" / f"{own}-rmse{suffix}"
        plots.save(figure, path, dpi=150)
    drawn["rmse"] = folder / "plots" / f"{own}-rmse.svg"
    reference = folder / "images" / f"{own}-reference.exr"
    counts = [cell["spp"] for cell in scene["variants"][0]["spp"]]
    spp = max((n for n in counts if n <= CROP_SPP), default=max(counts, default=0))
    pictures = []
    for name in _shown(scene):
        path = folder / "images" / f"{own}-{file_name(name)}-{spp}.exr"
        if path.exists():
            pictures.append((name, Image.load(path)))
    if reference.exists() and pictures:
        figure = plots.crops(scene, spp, Image.load(reference), pictures)
        drawn["crops"] = folder / "plots" / f"{own}-crops.png"
        plots.save(figure, drawn["crops"], dpi=130)
    return drawn


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


def share(value: float) -> str:
    """A share as a percentage with three digits, zeros as 0."""
    return f"{100.0 * value:.3g} %"


def data_uri(path: Path) -> str:
    """A file as the address of an image that needs no file."""
    content = base64.b64encode(path.read_bytes()).decode()
    return f"data:{_MIME[path.suffix]};base64,{content}"
