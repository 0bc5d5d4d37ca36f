"""Tables and figure of docs/results.md about the ladder: bench/results/ablation.

python bench/ladder_tables.py       draws the figure
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from ladder import FIRST, SHIPPED, SUFFIX, WITHOUT
from tables import FOLDER, Results, driver, table

from furcl.bench.convergence_statistics import Curve, compare_curves
from furcl.report.convergence import chosen, interval

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "ladder.png"
KEY = "results"  # of the figure's text chunk that says what it was drawn from
NOT_YET = "Not measured yet: `bash bench/ablation.sh` does it."
MAIN = "sky"


def measured(folder: Path = FOLDER) -> dict[str, Results]:
    """Results by light, that of the paper's experiments first."""
    files = sorted((folder / "ablation").glob("*/results.json"))
    found = {path.parent.name: json.loads(path.read_text()) for path in files}
    return dict(sorted(found.items(), key=lambda item: (item[0] != MAIN, item[0])))


def curve(results: Results, scene: str, variant: str) -> Curve:
    """What a variant did in the runs of a scene."""
    rows = [r for r in results["renders"] if (r["scene"], r["variant"]) == (scene, variant)]
    spp = sorted({row["spp"] for row in rows})
    runs = sorted({row["run"] for row in rows})
    at = {(row["run"], row["spp"]): row for row in rows}
    measures = (
        np.array([[at[run, n][key] for n in spp] for run in runs], np.float64)
        for key in ("seconds", "rmse", "rays")
    )
    return Curve(np.array(spp, np.float64), *measures)


def against(results: Results, scene: str, variant: str, other: str) -> Mapping[str, Any] | None:
    """A variant compared with another; None if one is not there or not resolved."""
    names = {found["name"] for found in results["plan"]["variants"]}
    if not {variant, other} <= names:
        return None
    curves = [curve(results, scene, name) for name in (variant, other)]
    return compare_curves(*curves) if all(c.resolved for c in curves) else None


def rungs(results: Results) -> Iterator[str]:
    """Names of the rungs, without those of the proposed sampler."""
    for found in results["plan"]["variants"]:
        if not found["name"].endswith(SUFFIX):
            yield found["name"]


def ladder(folder: Path = FOLDER) -> str:
    """Efficiency of every rung over the baseline in the scenes' own light, and what the proposed
    sampler adds in it."""
    found = measured(folder)
    if MAIN not in found:
        return NOT_YET
    results, rows = found[MAIN], []
    for scene in results["scenes"]:
        for name in rungs(results):
            gain = against(results, scene["name"], name, FIRST)
            proposed = against(results, scene["name"], name + SUFFIX, name)
            rows.append(
                [
                    scene["name"],
                    name,
                    "1" if name == FIRST else interval(gain and gain["efficiency"]),
                    "1" if name == FIRST else interval(gain and gain["efficiency_rays"]),
                    "1" if name == FIRST else _speed_up(results, scene["name"], name),
                    interval(proposed["efficiency"]) if proposed else "",
                ]
            )
    spp = results["plan"]["spp"]
    columns = [
        "scene",
        "variant",
        f"efficiency, {spp[0]} to {spp[-1]} spp",
        "by rays",
        f"times less time to the baseline's error at {spp[-1]} spp",
        "efficiency of attenuation-cdf over uniform-h",
    ]
    return table(columns, rows)


def _speed_up(results: Results, scene: str, name: str) -> str:
    """Time of the baseline's largest number of samples over a variant's time to the same error."""
    found = against(results, scene, FIRST, name)
    if found is None:
        return "-"
    last = found["equal_error"][-1]
    ends = {"mean": "mean", "low": "high", "high": "low"}
    inverse = {end: last["speed_up"][other] for end, other in ends.items()}
    inverse = {end: None if value is None else 1.0 / value for end, value in inverse.items()}
    return f"{interval(inverse)}{' *' if last['extrapolated'] else ''}"


def lights(folder: Path = FOLDER) -> str:
    """Efficiency over the baseline in all lights."""
    found = measured(folder)
    if not found:
        return NOT_YET
    names = list(dict.fromkeys(name for results in found.values() for name in rungs(results)))
    shown = [n for n in names if n != FIRST and not n.startswith(WITHOUT)]
    rows = []
    for light, results in found.items():
        for scene in results["scenes"]:
            gains = [against(results, scene["name"], name, FIRST) for name in shown]
            default = next((v for v in scene["variants"] if v["name"] == SHIPPED), None)
            rows.append(
                [
                    scene["name"],
                    light,
                    *(interval(gain and gain["efficiency"]) for gain in gains),
                    chosen(default["chosen"]) if default else "",
                ]
            )
    return table(["scene", "light", *shown, "default: auto chose"], rows)


def settings(folder: Path = FOLDER) -> str:
    """What the variants of the ladder are, and who measured."""
    found = measured(folder)
    if not found:
        return NOT_YET
    results = next(iter(found.values()))
    where = {
        f"{driver(r)} on {r['machine']['processor']}, {r['machine']['cores']} cores, {r['date']}, "
        f"commit {r.get('git', 'unknown')}"
        for r in found.values()
    }
    sizes = ", ".join(
        f"{light} {r['scenes'][0]['width']} x {r['scenes'][0]['height']} at "
        f"{', '.join(map(str, r['plan']['spp']))} spp"
        for light, r in found.items()
    )
    lines = [
        f"* `{v['name']}`: {' '.join(s.removeprefix('render.') for s in v['settings'])}"
        for v in results["plan"]["variants"]
        if not v["name"].endswith(SUFFIX)
    ]
    runs = f"{results['plan']['runs']} runs; {sizes}."
    first = f"`bash bench/ablation.sh`, {'; '.join(sorted(where))}. {runs}"
    return "\n".join([first, "", *lines])


def figure(folder: Path = FOLDER) -> str:
    """The figure's place, where there is something to show."""
    if MAIN not in measured(folder):
        return NOT_YET
    return f"![Efficiency over the baseline](figures/{FIGURE.name})"


def digest(folder: Path = FOLDER) -> str:
    """A hash of all that the figure shows."""
    return hashlib.sha256((ladder(folder) + lights(folder)).encode()).hexdigest()[:20]


TABLES = {
    "ladder-settings": settings,
    "ladder": ladder,
    "ladder-figure": figure,
    "ladder-lights": lights,
}


if __name__ == "__main__":
    import ladder_figure

    ladder_figure.write(measured(), FIGURE, {KEY: digest()})
