"""From single renders to results.json and results.csv (schema in docs/convergence.md)."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from furcl.bench.convergence_plan import Plan
from furcl.bench.convergence_state import State, name_of
from furcl.bench.convergence_statistics import (
    Curve,
    compare_curves,
    mean_interval,
    ratio_interval,
    slope,
)
from furcl.bench.record import write_json
from furcl.files import atomic_path
from furcl.groom.curves import Curves
from furcl.scene.schema import files_in
from furcl.scene.tables import Scene

SCHEMA = "furcl-convergence-2"
CONFIDENCE_95 = 1.96  # standard errors of a normal variable
MEASURES = ("seconds", "cpu_seconds", "rmse", "relmse", "flip")
CSV_COLUMNS = (
    "scene", "variant", "spp", "run", "seed", "seconds", "cpu_seconds", "mse_against_reference",
    "mse", "rmse", "relmse", "flip", "variance", "mean", "rays", "paths", "path_length",
    "hits_per_path", "nonfinite",
)  # fmt: skip


def scene_facts(scene: Scene, curves: Curves) -> dict[str, Any]:
    """Size, groom, light and how wide the fibres are on the film.

    Files below the current folder are named as from there.
    """
    camera = scene.resolved_camera(curves)
    assert camera.origin is not None
    document = msgspec.json.decode(msgspec.json.encode(scene))
    for keys, table in files_in(document):
        path = Path(table[keys[-1]])
        if path.is_relative_to(Path.cwd()):
            table[keys[-1]] = str(path.relative_to(Path.cwd()))
    distances = np.linalg.norm(curves.points - np.asarray(camera.origin), axis=1)
    if camera.orthographic:
        distances = np.ones_like(distances)
    pixel = 2.0 * camera.half_height / scene.film.height
    return {
        "width": scene.film.width,
        "height": scene.film.height,
        "strands": curves.n_strands,
        "segments": curves.n_segments,
        "fibre_width_px": float(np.median(2.0 * curves.radii / (distances * pixel))),
        "document": document,
    }


def assemble(
    plan: Plan, where: Mapping[str, Any], state: State, *, complete: bool
) -> dict[str, Any]:
    """The results of what has been rendered so far, with who measured it, `where`.

    Variants of a scene are compared over the runs that all of them have at all sample counts.
    """
    records, data = _in_plan(plan, state), state.data
    return {
        "schema": SCHEMA,
        **where,
        "complete": complete,
        "plan": {
            "variants": [variant.as_dict() for variant in plan.variants],
            "baseline": plan.baseline,
            "spp": list(plan.spp),
            "runs": plan.runs,
            "seed": plan.seed,
            "reference_spp": plan.reference_spp,
        },
        "scenes": [
            {
                "name": scene.name,
                **data["scenes"][scene.name],
                **_scene_results(plan, scene.name, records, data),
            }
            for scene in plan.scenes
            if scene.name in data["scenes"]
        ],
        "renders": [
            {"scene": scene, "variant": name, "spp": spp, "run": run, **record}
            for (scene, name, spp, run), record in records.items()
        ],
    }


Records = Mapping[tuple[str, str, int, int], Mapping[str, Any]]


def _in_plan(plan: Plan, state: State) -> Records:
    there = {
        (scene.name, name, *where): record
        for scene in plan.scenes
        for name in plan.names
        for where, record in state.of_variant(scene.name, name).items()
    }
    renders = [(name, spp, run) for run, spp, name in plan.renders()]
    wanted = [(scene.name, *render) for scene in plan.scenes for render in renders]
    return {key: there[key] for key in wanted if key in there}


def _scene_results(
    plan: Plan, scene: str, records: Records, data: Mapping[str, Any]
) -> dict[str, Any]:
    setup, reference = data["setup"], data["scenes"][scene]["reference"]
    whole = [
        run
        for run in range(plan.runs)
        if all((scene, n, spp, run) in records for n in plan.names for spp in plan.spp)
    ]
    curves = {name: _curve(records, scene, name, plan.spp, whole) for name in plan.names}
    found = []
    for name in plan.names:
        entry: dict[str, Any] = {"name": name, **setup.get(name_of(scene, name), {})}
        entry["spp"] = [
            _cell(spp, rows, reference)
            for spp in plan.spp
            if (
                rows := [
                    r for (s, n, c, _), r in records.items() if (s, n, c) == (scene, name, spp)
                ]
            )
        ]
        entry |= _lobe_statistics(
            [r for (s, n, _, _), r in records.items() if (s, n) == (scene, name)]
        )
        if curves[name].resolved:
            entry["slope"] = slope(plan.spp, curves[name].rmse).as_dict()
        found.append(entry)
    base = plan.baseline
    comparisons = [
        {"variant": name, "baseline": base, **compare_curves(curves[name], curves[base])}
        for name in plan.names
        if name != base and curves[name].resolved and curves[base].resolved
    ]
    return {
        "complete_runs": len(whole),
        "variants": found,
        "comparisons": comparisons,
        "unresolved": [name for name in plan.names if whole and not curves[name].resolved],
    }


def _curve(records: Records, scene: str, name: str, spp: tuple[int, ...], runs: list[int]) -> Curve:
    """What a variant did in some runs."""
    measures = (_table(records, scene, name, spp, runs, m) for m in ("seconds", "rmse", "rays"))
    return Curve(np.array(spp, np.float64), *measures)


def _table(
    records: Records, scene: str, name: str, spp: tuple[int, ...], runs: list[int], key: str
) -> np.ndarray:
    """(runs, spp) values of a measure."""
    rows = [[records[scene, name, s, run][key] for s in spp] for run in runs]
    return np.array(rows, np.float64).reshape(len(runs), len(spp))


def _cell(spp: int, rows: list[Mapping[str, Any]], reference: Mapping[str, Any]) -> dict[str, Any]:
    """One variant at one sample count."""
    cell: dict[str, Any] = {"spp": spp, "runs": len(rows)}
    for name in MEASURES:
        cell[name] = mean_interval([row[name] for row in rows]).as_dict()
    own = [row["variance"] for row in rows]
    cell["variance"] = None if None in own else float(np.mean(own))
    positive = [row["mse"] / row["variance"] for row in rows if row["variance"] and row["mse"] > 0]
    cell["mse_over_variance"] = ratio_interval(positive).as_dict() if positive else None
    ratio = mean_interval([row["mean"] / reference["mean"] for row in rows])
    cell["mean_over_reference"] = ratio.widened(
        CONFIDENCE_95 * reference["mean_error"] / reference["mean"]
    ).as_dict()
    cell["reference_share"] = float(
        np.mean([1.0 - row["mse"] / row["mse_against_reference"] for row in rows])
    )
    cell["rays"] = float(np.mean([row["rays"] for row in rows]))
    cell["mrays_s"] = float(np.mean([row["rays"] / row["seconds"] / 1e6 for row in rows]))
    return cell


def _lobe_statistics(rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    """Over all renders of a variant: which lobes it chose, and how long its paths were."""
    if not rows:
        return {}
    counts = {name: sum(row["lobes"][name] for row in rows) for name in rows[0]["lobes"]}
    total = max(sum(counts.values()), 1)
    paths = sum(row["paths"] for row in rows)
    return {
        "lobes": {
            "counts": counts,
            "shares": {name: count / total for name, count in counts.items()},
            "total": sum(counts.values()),
        },
        "paths": paths,
        "path_length": sum(row["path_length"] * row["paths"] for row in rows) / paths,
        "hits_per_path": sum(row["hits_per_path"] * row["paths"] for row in rows) / paths,
        "nonfinite": sum(row["nonfinite"] for row in rows),
    }


def write_results(results: Mapping[str, Any], folder: Path) -> None:
    """Write results.json and results.csv (one line a render)."""
    write_json(dict(results), folder / "results.json")
    lobes = list(dict.fromkeys(name for row in results["renders"] for name in row["lobes"]))
    with (
        atomic_path(folder / "results.csv") as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file)
        writer.writerow([*CSV_COLUMNS, *lobes])
        for row in results["renders"]:
            writer.writerow(
                [*(row[name] for name in CSV_COLUMNS), *(row["lobes"].get(n, 0) for n in lobes)]
            )
