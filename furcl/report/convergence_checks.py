"""Variants of a convergence run whose pictures are not those of the reference."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from scipy import stats

#: Chance that a run marks one of its variants though all are unbiased.
ALPHA = 0.01
_MEASURES = {
    "mean": ("mean_over_reference", "mean radiance over that of the reference"),
    "own_variance": ("mse_over_variance", "error over own variance"),
}


def departures(results: Mapping[str, Any]) -> dict[tuple[str, str], list[str]]:
    """What is wrong with variants, by names of scene and variant; only those that are marked.

    A measure that is 1 without bias is compared with 1 by Student's t over the runs, each of the m
    comparisons of a run of the benchmark at ALPHA / m (Bonferroni). Of the mean, the error of the
    reference itself is allowed for, as often as the normal distribution says. Measures that say
    nothing of a variant (its `checks`) are not looked at. tests/test_convergence_checks.py counts
    false marks.

    Parameters
    ----------
    results : mapping       as results.json has them
    """
    cells = list(_cells(results))
    level = 1.0 - 0.5 * ALPHA / max(len(cells), 1)
    found: dict[tuple[str, str], list[str]] = {}
    for scene, variant, cell, check, estimate in cells:
        degrees = cell["runs"] - 1
        wider = float(stats.t.ppf(level, degrees) / stats.t.ppf(0.975, degrees))
        half = 0.5 * (estimate["high"] - estimate["low"]) * wider
        if check == "mean":
            half += float(stats.norm.ppf(level)) * _of_reference(scene)
        if abs(estimate["mean"] - 1.0) > half:
            said = f"{_MEASURES[check][1]} {estimate['mean']:.4g} at {cell['spp']} spp"
            found.setdefault((scene["name"], variant["name"]), []).append(said)
    return found


def _cells(results) -> Iterator[tuple[Any, Any, Any, str, Any]]:
    """Estimates that are 1 of a variant without bias."""
    for scene in results["scenes"]:
        for variant in scene["variants"]:
            for check, (key, _) in _MEASURES.items():
                if variant.get("checks", {check: "not known"}).get(check) is not None:
                    continue
                for cell in variant["spp"]:
                    estimate = cell.get(key)
                    if estimate and estimate["low"] is not None and cell.get("runs", 0) > 1:
                        yield scene, variant, cell, check, estimate


def _of_reference(scene) -> float:
    """Standard error of the reference's mean radiance, over that."""
    reference = scene["reference"]
    error = reference.get("mean_error")
    return error / reference["mean"] if error and reference["mean"] else 0.0
