"""What attenuation-cdf gains over uniform-h where fibres are seen wide: in the far field and with h
from the camera's ray (docs/model.md, Near field). In mode "near" both are the same sampler.

python bench/where_it_pays_close.py [-o FOLDER] [--device D] [--quick]

Black hair of bench/where_it_pays.py, in even light and in that of a broad sun in front, by a camera
that comes near by its angle: one spot in the middle of the hair, whose fibres are so many pixels
wide. Writes FOLDER/close.json.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tables import FOLDER
from where_it_pays import (
    EVEN,
    SAMPLERS,
    SAMPLES,
    SCENE,
    SIZE,
    Cell,
    measure_cell,
    of_cell,
    shown,
)

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.scene.read import load_scene

WIDTHS = (1.0, 4.0)  # of a fibre [px]
MODES = ("far", "multiscale")
GROUPS = 16
LIGHTS = (EVEN, ("front", 60.0))
STRANDS, BLACK = 3_000, 4.1


def cells() -> Iterator[Cell]:
    """Every cell: width, light, mode."""
    for width, (light, angle), mode in itertools.product(WIDTHS, LIGHTS, MODES):
        yield {
            "light": light,
            "angle_deg": angle,
            "strands": STRANDS,
            "sigma_ca": BLACK,
            "width_px": width,
            "mode": mode,
        }


def view(cell: Cell) -> list[str]:
    """Overrides that show fibres as wide as a cell says, at the depth of the camera's target."""
    scene = load_scene(SCENE, overrides=of_cell(cell), size=SIZE)
    grooms = scene.build_grooms()
    camera = scene.resolved_camera(grooms.curves)
    assert camera.origin is not None
    distance = math.dist(camera.origin, camera.target)
    height = np.median(grooms.curves.radii) * 2.0 / cell["width_px"] * scene.film.height
    origin, target = (",".join(map(repr, map(float, p))) for p in (camera.origin, camera.target))
    vfov = math.degrees(2.0 * math.atan(0.5 * height / distance))
    return [f"camera={{origin=[{origin}],target=[{target}],vfov_deg={vfov}}}"]


def main() -> None:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(description=f"{summary} {rest}")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER / "where_it_pays")
    parser.add_argument("--device", default=None)
    parser.add_argument("--quick", action="store_true", help="few groups, to try the script")
    options = parser.parse_args()
    device = open_device(options.device)
    groups = 3 if options.quick else GROUPS
    rows = []
    for cell in cells():
        settings = [f"fibre.mode={cell['mode']}", *view(cell)]
        rows.append(measure_cell(cell, device, groups, SIZE, settings=settings))
        print(f"{cell['width_px']:5g} px {cell['mode']:>10} {shown(rows[-1])}", flush=True)
    numbers = {"size": SIZE, "groups": groups, "samples": SAMPLES, "samplers": list(SAMPLERS)}
    record = {**circumstances(device), **numbers, "cells": rows}
    write_json(record, options.output / "close.json")


if __name__ == "__main__":
    main()
