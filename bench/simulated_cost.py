"""What simulated scattering costs a picture: both ways take turns.

    python bench/simulated_cost.py [-o bench/results] [--size WxH] [--spp N] [--rounds N]
                                   [--device TEXT]

Ratios, simulated over model, of processor time a ray, of rays a path, and of the mean of the
picture; medians of the rounds with their 95 % interval. On a machine that others use only the
ratio of what took turns says anything.

Writes simulated_cost.json into the folder given by -o, of which docs_tables.py makes the table of
docs/model.md.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

import numpy as np

from furcl.bench.pairs import in_turns, median_interval
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene, with_overrides

SCENES = ("raccoon", "red_fox", "black_hair")


def measure(name: str, size: str, spp: int, rounds: int, device: Device) -> dict:
    """One scene."""
    scene = with_overrides(load_scene(name), size=size)
    both = {
        scattering: Renderer(with_overrides(scene, [f"fibre.scattering={scattering}"]), device)
        for scattering in ("model", "simulated")
    }
    for renderer in both.values():
        renderer.advance(1)
    rays = {key: renderer.rays for key, renderer in both.items()}
    turns = in_turns({key: partial(r.advance, spp) for key, r in both.items()}, rounds)
    images = {key: renderer.image() for key, renderer in both.items()}
    rays = {key: renderer.rays - rays[key] for key, renderer in both.items()}
    more_rays = rays["simulated"] / rays["model"]
    cost = turns["simulated"].cpu / turns["model"].cpu / more_rays
    found = median_interval(cost)
    mean = [float(images[key].rgb.mean(dtype=np.float64)) for key in ("model", "simulated")]
    return {
        "cost_of_a_ray": found.median,
        "interval": [found.low, found.high],
        "rays": more_rays,
        "mean": mean[1] / mean[0],
    }


def main() -> None:
    """Measure the scenes and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--size", default="128x128")
    parser.add_argument("--spp", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--device", default="", help="as for furcl render")
    options = parser.parse_args()
    device = open_device(options.device or None)
    scenes = {}
    for name in SCENES:
        scenes[name] = measure(name, options.size, options.spp, options.rounds, device)
        print(f"{name}: {scenes[name]}", file=sys.stderr)
    settings = {"size": options.size, "spp": options.spp, "rounds": options.rounds}
    record = {**circumstances(device), **settings, "scenes": scenes}
    write_json(record, options.output / "simulated_cost.json")


if __name__ == "__main__":
    main()
