"""The compile matrix: values of every field of Features, and few rows with all pairs of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from furcl.device.features import Features
from furcl.device.layout import ABSORPTIONS, FILTERS, LAYERS, MODES, SEQUENCES
from furcl.fibre import samplers
from furcl.fibre.double_cylinder.features import DoubleCylinderFeatures
from furcl.fibre.double_cylinder.model import MODEL
from furcl.light import kinds as lights
from furcl.light.lamps.layout import KINDS, LampsPart
from furcl.rendering.layers import LayerPart
from furcl.rendering.learning import LearningPart
from furcl.surface.ellipsoid import PART
from furcl.surface.mesh.mesh import MeshPart

Row = dict[str, Any]

EVERY_LAYER = LayerPart(LAYERS, tuple(lobe.name for lobe in MODEL.lobes))

# Every field of Features and of the fibre's, and the values that scenes can give it.
FIBRE_VALUES = {
    "medulla": (False, True),
    "scattered": (False, True),
    "profile_channels": (0, 1, 3),
    "simulated": (False, True),
    "layered": (False, True),
    "tilt": (False, True),
    "residual": (False, True),
    "dropped_lobes": ((), ("TRT",)),
}
VALUES: dict[str, Sequence[Any]] = {
    **FIBRE_VALUES,
    "sampler": samplers.BUILT_IN,
    "fibres": (1, 2),
    "channels": (1, 3),
    "light": (None, *(light.kind for light in lights.BUILT_IN)),
    "absorption": ABSORPTIONS,
    "mode": MODES,
    "lamps": (
        None,
        LampsPart(KINDS),
        LampsPart(("quad", "sphere"), by_position=False),
        LampsPart(("disk", "spot")),
        LampsPart(("point",)),
        LampsPart(("distant",)),
        LampsPart(("triangle",)),
    ),
    "light_sampling": (False, True),
    "point_radii": (False, True),
    "surface": (None, PART),
    "meshes": (
        None,
        *(
            MeshPart(*flags, coat=flags[1] != flags[2])
            for flags in itertools.product((False, True), repeat=3)
        ),
    ),
    "motion": (0, 2),
    "camera_motion": (0, 1),
    "lens": (False, True),
    "orthographic": (False, True),
    "crop": (False, True),
    "filter": FILTERS,
    "sequence": SEQUENCES,
    "roulette": (False, True),
    "shadow_roulette": (False, True),
    "learning": (None, LearningPart()),
    "layers": (None, EVERY_LAYER, LayerPart(("depth",)), LayerPart(("strand", "indirect"))),
    "transparent": (False, True),
    "variance": (False, True),
    "planned": (False, True),
    "held": (False, True),
    "statistics": (False, True),
    "debug": (False,),
}


def features_of(values: Mapping[str, Any]) -> Features:
    """The Features of a row of values."""
    own = {name: values[name] for name in FIBRE_VALUES if name in values}
    rest = {name: value for name, value in values.items() if name not in FIBRE_VALUES}
    sampler = samplers.find(rest.get("sampler", "full-cdf"))
    rest["sampler"] = samplers.in_mode(sampler, rest.get("mode", "far"))
    light = rest.get("light", "constant")
    rest["light"] = lights.find(light).part() if light else None
    return Features(fibre=DoubleCylinderFeatures(**own), **rest)


def reachable(values: Mapping[str, Any]) -> bool:
    """Combinations that a scene can have: scattering needs a medulla, colours need channels, a plan
    needs variance; there is some light; a groom that moves has a radius a point. Simulated
    scattering has the residual lobe, and one absorption."""
    if values["simulated"] and not (values["residual"] and values["absorption"] == "constant"):
        return False
    if values["motion"] and not values["point_radii"]:
        return False
    if values["planned"] and not values["variance"]:
        return False
    if values["light"] is None and values["lamps"] is None:
        return False
    if values["scattered"] and not values["medulla"]:
        return False
    if values["profile_channels"] and not values["scattered"]:
        return False
    if values["shadow_roulette"] and not values["light_sampling"]:
        return False
    return not (values["channels"] == 1 and values["profile_channels"] == 3)


def pairwise(
    values: Mapping[str, Sequence[Any]], reachable: Callable[[Row], bool]
) -> tuple[list[Row], set[tuple[str, Any, str, Any]]]:
    """Few combinations in which every reachable pair of values of two fields occurs (greedy).

    Returns
    -------
    rows : list         name -> value
    missing : set       (name, value, name, value) of the pairs in none of them
    """
    names = list(values)
    rng = np.random.default_rng(7)
    missing = {
        (a, u, b, v)
        for a, b in itertools.combinations(names, 2)
        for u in values[a]
        for v in values[b]
    }
    rows = []
    stale = 0
    while missing and stale < 30:
        candidates = []
        for _ in range(60):
            row = {name: values[name][int(rng.integers(len(values[name])))] for name in names}
            if reachable(row):
                candidates.append(row)
        covered = [{p for p in missing if r[p[0]] == p[1] and r[p[2]] == p[3]} for r in candidates]
        best = max(range(len(candidates)), key=lambda i: len(covered[i]))
        stale = 0 if covered[best] else stale + 1
        if covered[best]:
            rows.append(candidates[best])
            missing -= covered[best]
    return rows, missing


def covering(rows: Sequence[Row]) -> list[Row]:
    """Few of the rows in which every value of every field occurs (greedy)."""
    missing = {(name, value) for row in rows for name, value in row.items()}
    found: list[Row] = []
    while missing:
        best = max(rows, key=lambda row: len(missing & row.items()))
        found.append(best)
        missing -= best.items()
    return found
