"""Tables of docs/results.md: bench/results/model_samplers.json."""

from __future__ import annotations

from typing import Any

from tables import circumstances, load, table

from furcl.report.convergence import interval


def ratios(results: dict[str, Any], mode: str) -> str:
    """RMSE over that of uniform-h, models and samplers by scenes."""
    found = {
        (row["model"], row["sampler"], row["scene"]): interval(row["ratio"])
        for row in results["rows"]
        if row["mode"] == mode
    }
    scenes = list(dict.fromkeys(scene for _, _, scene in found))
    pairs = dict.fromkeys((model, sampler) for model, sampler, _ in found)
    rows = [
        [f"`{model}`", sampler, *(found[model, sampler, scene] for scene in scenes)]
        for model, sampler in pairs
    ]
    return table(["model", "sampler", *scenes], rows)


def far() -> str:
    """In the far field, and how all was measured."""
    results = load("model_samplers.json")
    side, other = results["size"]
    few, many = results["spp"]
    settings = (
        f"{side} x {other} pixels, {many} spp ({few} and {many} rendered), a reference of "
        f"{results['reference_spp']}, 5 runs."
    )
    return f"{circumstances(results)}\n\n{settings}\n\n{ratios(results, 'far')}"


TABLES = {
    "model-samplers-far": far,
    "model-samplers-near": lambda: ratios(load("model_samplers.json"), "near"),
}
