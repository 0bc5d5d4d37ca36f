"""The parameters of a scene's fibres as sliders: what each model says of its own."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from furcl.fibre import model as models
from furcl.fibre.model import FibreModel, ModelTable, model_of
from furcl.scene.meanings import meanings
from furcl.scene.tables import Scene

#: Ranges that reach so far up have sliders that are even in the logarithm from about
#: SMALLEST_DIFFERENCE on.
FAR = 50.0
SMALLEST_DIFFERENCE = 0.01

#: Keys that give a colour in the place of the absorption.
OTHER_COLOURS = ("colour", "melanin")


def key_of(scene: Scene, material: str) -> str:
    """The key of the table of a fibre material, which `Scene.materials` calls so."""
    if material == "fibre" and scene.fibre is not None:
        return "fibre"
    if material in scene.material:
        return f"material.{material}"
    return f"groom.{material.removeprefix('groom ')}.fibre"


def materials(scene: Scene) -> list[dict[str, Any]]:
    """What sliders need to know of each fibre material, as JSON values: name, key, model, preset,
    whether its colour differs between strands, and `fields` of `parameters`."""
    fibres = scene.build_fibres()
    return [
        {
            "name": name,
            "key": key_of(scene, name),
            "model": fibres[name].model,
            "models": list(models.names()),
            "preset": getattr(table, "preset", None),
            "presets": list(table.allowed.get("preset", ())),
            "fields": parameters(table, fibres[name]),
        }
        for name, table in scene.materials().items()
    ]


def parameters(table: ModelTable, fibre: Any) -> list[dict[str, Any]]:
    """The numbers of a fibre: name, meaning, unit, low, high, scale, value, which is one number or
    three, and `varies`, true where strands or points have their own."""
    described = type(fibre)
    told = {}
    for of in reversed(described.__mro__):  # a fibre may describe what it adds to another
        told |= meanings(of.__doc__)
    model = model_of(fibre)
    found = []
    for field in dataclasses.fields(described):
        limits = table.allowed.get(field.name)
        if field.name not in told or not limits or isinstance(limits[0], str):
            continue
        meaning = told[field.name]
        found.append(
            {
                "name": field.name,
                "meaning": meaning.text,
                "unit": meaning.unit,
                "low": limits[0],
                "high": limits[1],
                "scale": _scale(*limits),
                "value": getattr(fibre, field.name),
                "varies": _varies(table, model, field.name),
            }
        )
    return found


def _scale(low: float, high: float) -> float:
    """Growth of a slider from its lower to its upper end: 0 is an even one."""
    return math.log(high / SMALLEST_DIFFERENCE) if low >= 0.0 and high > FAR else 0.0


def _varies(table: ModelTable, model: FibreModel, name: str) -> bool:
    return bool(
        name == model.absorbed and table.absorption is not None and table.absorption.has_values
    )
