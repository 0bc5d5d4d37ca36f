"""What simulated scattering costs beside the published one: time of pictures, tables and bytes.

python bench/scattering_cost.py [SCENE...] [--size 256x256] [--spp 8] [--rounds 7] [--device TEXT]
    [-o FILE.json]

Renders take turns; ratios are simulated over published, medians of the rounds with 95 % intervals.
Those of processor time are the ones to read where other work runs on the machine. Tables are made
anew, compiled before, three times in turns, and not read from the cache.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.pairs import in_turns, median_interval
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.fibre.double_cylinder.profiles import build_profiles
from furcl.fibre.double_cylinder.simulated import build_simulated
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene

SCENES = ("raccoon", "red_fox")
BUILDS = {"model": build_profiles, "simulated": build_simulated}
FIRST, SECOND = BUILDS
TABLE_ROUNDS = 3


def of_pictures(scene: Scene, device: Device, spp: int, rounds: int) -> dict[str, Any]:
    """Time, rays and time a ray of renders, simulated over published, and published seconds."""
    curves = scene.build_curves()
    renderers = {
        way: Renderer(with_overrides(scene, [f"fibre.scattering={way}"]), device, curves=curves)
        for way in BUILDS
    }

    def action(renderer: Renderer) -> Any:
        def render() -> None:
            renderer.restart(1)
            renderer.advance(spp)

        return render

    seconds = in_turns({way: action(r) for way, r in renderers.items()}, rounds)
    rays = renderers[SECOND].rays / renderers[FIRST].rays
    wall = seconds[SECOND].wall / seconds[FIRST].wall
    busy = seconds[SECOND].cpu / seconds[FIRST].cpu
    return {
        "seconds": {way: float(np.median(found.wall)) for way, found in seconds.items()},
        "time": asdict(median_interval(wall)),
        "processor_time": asdict(median_interval(busy)),
        "rays": rays,
        "time_of_a_ray": asdict(median_interval(busy / rays)),
    }


def of_tables(scene: Scene, device: Device) -> dict[str, Any]:
    """Processor seconds to make the tables of a scene's fibre each way, and their bytes."""
    fibres = {way: scene.build_fibre().replace(scattering=way) for way in BUILDS}
    sizes = {way: BUILDS[way](device, fibres[way]).pack().nbytes for way in BUILDS}

    def action(way: str) -> Any:
        return lambda: BUILDS[way](device, fibres[way], cache=False)

    seconds = in_turns({way: action(way) for way in BUILDS}, TABLE_ROUNDS)
    return {
        "bytes": sizes,
        "processor_seconds": {way: float(np.median(t.cpu)) for way, t in seconds.items()},
    }


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--size", default="256x256")
    parser.add_argument("--spp", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--device")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    device = open_device(options.device)
    found = {}
    for name in options.scenes:
        scene = load_scene(name, size=options.size)
        found[name] = {
            "pictures": of_pictures(scene, device, options.spp, options.rounds),
            "tables": of_tables(scene, device),
        }
        print(name, found[name], file=sys.stderr, flush=True)
    if options.output:
        facts = {"size": options.size, "spp": options.spp, "rounds": options.rounds}
        write_json({**circumstances(device), **facts, "scenes": found}, options.output)


if __name__ == "__main__":
    main()
