"""Results of a convergence run in their present form, whichever version of furcl wrote them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

OLD = "furcl-convergence-1"
PRESENT = "furcl-convergence-2"

_HOLD = {"slope": None, "own_variance": None, "mean": None}


def upgraded(results: Mapping[str, Any]) -> dict[str, Any]:
    """Results of `furcl-convergence-1`, which compared samplers, as ones that compare variants.

    Efficiency by rays and at single numbers of samples was not measured and is None. Results of the
    present form are returned as they are.
    """
    if results["schema"] != OLD:
        return dict(results)
    names = results["plan"]["sampling"]
    plan = {key: value for key, value in results["plan"].items() if key != "sampling"}
    return {
        **results,
        "schema": PRESENT,
        "plan": {
            "variants": [{"name": n, "settings": [f"render.sampling={n}"]} for n in names],
            "baseline": names[0],
            **plan,
        },
        "scenes": [_scene(scene) for scene in results["scenes"]],
        "renders": [_renamed(row) for row in results["renders"]],
    }


def _scene(scene: Mapping[str, Any]) -> dict[str, Any]:
    tables = {name: scene["document"][name] for name in ("render", "film")}
    variants = [
        {
            "settings": {**tables, "render": {**tables["render"], "sampling": found["name"]}},
            "chosen": {},
            "checks": _HOLD,
            **found,
        }
        for found in scene["samplers"]
    ]
    kept = {key: value for key, value in scene.items() if key != "samplers"}
    return {
        **kept,
        "reference": {"variant": scene["reference"]["sampling"], **scene["reference"]},
        "variants": variants,
        "comparisons": [_comparison(found) for found in scene["comparisons"]],
        "unresolved": [],
    }


def _comparison(found: Mapping[str, Any]) -> dict[str, Any]:
    unknown = {"efficiency": None, "efficiency_rays": None}
    same = [{**row, **unknown} for row in found["same_spp"]]
    return {**_renamed(found), "same_spp": same, "efficiency_rays": None}


def _renamed(row: Mapping[str, Any]) -> dict[str, Any]:
    return {"variant" if key == "sampling" else key: value for key, value in row.items()}
