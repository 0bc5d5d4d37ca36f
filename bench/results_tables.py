"""Write the tables of docs/results.md from bench/results/convergence, between their markers.

python bench/results_tables.py docs/results.md
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from furcl.report.convergence import interval, number, share

FOLDER = Path(__file__).parent / "results" / "convergence"

# RMSE of the proposed over that of the conventional sampler, and spp: tables 5 (at equal time), 6
# and 7 (at equal spp) of the paper.
PAPER_RATIOS = {
    "black_hair": ("equal_time", {64: 0.91, 128: 0.84, 256: 0.77, 512: 0.76}),
    "white_hair": ("same_spp", {64: 0.97, 128: 0.97, 256: 0.98, 512: 0.98}),
    "raccoon": ("same_spp", {64: 0.98, 128: 0.98, 256: 0.97, 512: 0.98}),
}
# Shares of the chosen lobes [%], tables 2 to 4: conventional, proposed.
PAPER_LOBES = {
    "black_hair": {
        "R": (95.1, 93.7), "TT": (1.11, 3.04), "TRT": (0.000348, 0.0057),
        "TTs": (3.77, 3.28), "TRTs": (0.000697, 0.00244),
    },
    "white_hair": {
        "R": (11.8, 12.7), "TT": (31.1, 34.0), "TRT": (0.997, 1.11),
        "TTs": (54.5, 50.5), "TRTs": (1.49, 1.73),
    },
    "raccoon": {
        "R": (13.2, 14.6), "TT": (13.7, 15.8), "TRT": (0.739, 1.01),
        "TTs": (71.0, 66.9), "TRTs": (1.34, 1.68),
    },
}  # fmt: skip


def load(name: str) -> dict[str, Any]:
    """The results of one of the runs."""
    return json.loads((FOLDER / name / "results.json").read_text())


def table(columns: list[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table, first column to the left."""
    lines = [columns, ["---", *["---:"] * (len(columns) - 1)], *map(list, rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def circumstances() -> str:
    """Where and how the runs were made."""
    results = load("scenes")
    machine, device = results["machine"], results["device"]
    commit = f", commit {results['git']}" if "git" in results else ""
    return (
        f"furcl {results['version']}{commit}, {results['date']}; {device['name']} "
        f"({device['platform']}), {machine['processor']}, {machine['cores']} cores.\n\n"
        f"    {results['command']}\n\n"
        "The other runs and their commands are in `bench/convergence.sh`."
    )


def ratios() -> str:
    """RMSE over that of uniform-h at the largest number of samples: ours and the paper's."""
    rows = []
    for scene in load("scenes")["scenes"]:
        kind, paper = PAPER_RATIOS[scene["name"]]
        label = "equal time" if kind == "equal_time" else "equal spp"
        text = ", ".join(f"{ratio} ({spp} spp)" for spp, ratio in paper.items())
        for found in scene["comparisons"]:
            rows.append(
                [
                    scene["name"],
                    found["sampling"],
                    interval(found["same_spp"][-1]["rmse_ratio"]),
                    interval(found["equal_time"][-1]["rmse_ratio"]),
                    f"{label}: {text}" if found["sampling"] == "attenuation-cdf" else "",
                ]
            )
    spp = load("scenes")["plan"]["spp"][-1]
    columns = ["scene", "sampler", f"equal spp, {spp}", f"equal time, {spp} spp", "paper"]
    return table(columns, rows)


def overall() -> str:
    """Efficiency over all sample counts, slope, rays a path and time."""
    rows = []
    for scene in load("scenes")["scenes"]:
        found = {c["sampling"]: c for c in scene["comparisons"]}
        for sampler in scene["samplers"]:
            last = sampler["spp"][-1]
            efficiency = found[sampler["name"]]["efficiency"] if sampler["name"] in found else None
            rows.append(
                [
                    scene["name"],
                    sampler["name"],
                    number(last["seconds"]["mean"]),
                    interval(last["rmse"]),
                    interval(efficiency) if efficiency else "1",
                    interval(sampler["slope"]),
                    number(sampler["path_length"]),
                    interval(last["mse_over_variance"]),
                ]
            )
    spp = load("scenes")["plan"]["spp"][-1]
    return table(
        [
            "scene",
            "sampler",
            f"time [s], {spp} spp",
            f"RMSE, {spp} spp",
            "efficiency",
            "slope",
            "rays a path",
            "MSE over own variance",
        ],
        rows,
    )


def lobes() -> str:
    """Shares of the chosen lobes beside the paper's."""
    rows = []
    for scene in load("scenes")["scenes"]:
        ours = {s["name"]: s["lobes"]["shares"] for s in scene["samplers"]}
        for lobe, (conventional, proposed) in PAPER_LOBES[scene["name"]].items():
            rows.append(
                [
                    scene["name"],
                    lobe,
                    share(ours["uniform-h"][lobe]),
                    f"{conventional:.3g} %",
                    share(ours["attenuation-cdf"][lobe]),
                    f"{proposed:.3g} %",
                ]
            )
    columns = ["scene", "lobe", "uniform-h", "paper", "attenuation-cdf", "paper"]
    return table(columns, rows)


def others() -> str:
    """The runs in other light and of one fibre."""
    rows = []
    for folder in sorted(path.parent for path in FOLDER.glob("*/results.json")):
        if folder.name == "scenes":
            continue
        for found in load(folder.name)["scenes"][0]["comparisons"]:
            rows.append(
                [
                    folder.name,
                    found["sampling"],
                    interval(found["same_spp"][-1]["rmse_ratio"]),
                    interval(found["equal_time"][-1]["rmse_ratio"]),
                    interval(found["efficiency"]),
                ]
            )
    return table(["run", "sampler", "equal spp", "equal time", "efficiency"], rows)


TABLES = {
    "circumstances": circumstances,
    "ratios": ratios,
    "overall": overall,
    "lobes": lobes,
    "others": others,
}


def filled(text: str, tables: dict[str, Callable[[], str]]) -> str:
    """The document with every table made anew."""
    for name, make in tables.items():
        pattern = rf"(<!-- {name} -->\n).*?(<!-- end -->)"
        text, count = re.subn(
            pattern, lambda m, make=make: f"{m[1]}\n{make()}\n\n{m[2]}", text, flags=re.DOTALL
        )
        if count != 1:
            raise SystemExit(f"<!-- {name} --> ... <!-- end --> is there {count} times, not once")
    return text


if __name__ == "__main__":
    document = Path(sys.argv[1])
    document.write_text(filled(document.read_text(), TABLES))
