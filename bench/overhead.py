"""What Sobol numbers, plans of samples and learning cost, in processor seconds of a render.

python bench/overhead.py [SCENE...] [--size 128x128] [--spp 64] [--rounds 9] [--device TEXT]
    [-o FILE.json]

Renders of the same paths take turns: plain ones, with independent numbers, the same number of
samples for every pixel and constant thresholds of roulette; those with one of the three; and those
with all. What is planned and learned is worked out and then not used, so that paths do not get
longer or fewer by it: plans give all pixels the same weight, and thresholds stay what they are in
the plain render. Printed are medians of the times over those of the plain render of the same
round, with 95 % intervals, and the rays of all over those of plain ones, which is to be 1. Learning
includes its grid of optical depths, which is made once a render.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from ladder import SCENES

from furcl.bench.pairs import Median, in_turns, median_interval
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.groom.optical_depth import optical_depths
from furcl.rendering import allocation, learning
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene

PATHS, LIGHTS = 0.3, 0.1  # thresholds of throughput, and of a light sample's radiance
PLAIN = {
    "sequence": "independent",
    "allocation": "even",
    "roulette": "throughput",
    "roulette_threshold": PATHS,
    "shadow_threshold": LIGHTS,
}
PARTS = {
    "numbers": {"sequence": "sobol"},
    "allocation": {"allocation": "adaptive"},
    "learning": {"roulette": "adjoint"},
}
FIRST, ALL = "plain", "all"


@contextmanager
def unused() -> Iterator[None]:
    """Plans and thresholds are computed, but pixels weigh the same and thresholds stay."""
    weights, thresholds = allocation.weights, learning.thresholds

    def even_weights(*arguments: Any) -> np.ndarray:
        return np.ones_like(weights(*arguments))

    def constant_thresholds(*arguments: Any) -> tuple[np.ndarray, np.ndarray]:
        paths, lights = thresholds(*arguments)
        return np.full_like(paths, PATHS), np.full_like(lights, LIGHTS)

    with (
        patch.object(allocation, "weights", even_weights),
        patch.object(learning, "thresholds", constant_thresholds),
    ):
        yield


def settings() -> dict[str, dict[str, Any]]:
    """Name -> keys of [render]: plain, each part alone, all."""
    whole = {key: value for part in PARTS.values() for key, value in part.items()}
    parts = {name: {**PLAIN, **part} for name, part in PARTS.items()}
    return {FIRST: PLAIN, **parts, ALL: {**PLAIN, **whole}}


def measure(scene: Scene, device: Device, spp: int, rounds: int) -> dict[str, Any]:
    """A scene's medians of processor seconds over those of the plain render, and its rays."""
    curves = scene.build_curves()
    renderers = {
        name: Renderer(
            with_overrides(scene, [f"render.{key}={value}" for key, value in keys.items()]),
            device,
            curves=curves,
        )
        for name, keys in settings().items()
    }

    def action(renderer: Renderer) -> Callable[[], None]:
        def render() -> None:
            renderer.restart(1)
            if renderer.setup.learning:
                optical_depths(curves)
            renderer.advance(spp)

        return render

    with unused():
        seconds = in_turns({name: action(r) for name, r in renderers.items()}, rounds)
    plain = seconds.pop(FIRST).cpu
    ratios = {name: median_interval(found.cpu / plain) for name, found in seconds.items()}
    return {
        "scene": scene.name,
        "seconds": float(np.median(plain)),
        "ratios": {name: asdict(ratio) for name, ratio in ratios.items()},
        "rays": {name: r.rays / renderers[FIRST].rays for name, r in renderers.items()},
    }


def shown(found: Mapping[str, Any]) -> str:
    """A median of times over others as percent more, with its interval."""
    ratio = Median(**found)
    ends = "" if ratio.low is None or ratio.high is None else f" [{_percent(ratio.low)}, "
    return _percent(ratio.median) + (ends and f"{ends}{_percent(ratio.high)}]")


def _percent(ratio: float) -> str:
    return f"{100.0 * (ratio - 1.0):+.1f}"


def main(words: list[str]) -> None:
    """Measure, print a row a scene, and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--size", default="128x128")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--device")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args(words)
    device = open_device(options.device)
    names = [*PARTS, ALL]
    print(f"| scene | plain, s | {' | '.join(f'{name}, %' for name in names)} | rays, all |")
    print("| --- |" + " ---: |" * (len(names) + 2), flush=True)
    rows = []
    for name in options.scenes:
        row = measure(load_scene(name, size=options.size), device, options.spp, options.rounds)
        rows.append(row)
        cells = [shown(row["ratios"][part]) for part in names]
        rays = f"x {row['rays'][ALL]:.3f}"
        print(
            f"| {row['scene']} | {row['seconds']:.2f} | {' | '.join(cells)} | {rays} |", flush=True
        )
    if options.output:
        facts = {"spp": options.spp, "size": options.size, "rounds": options.rounds}
        write_json({**circumstances(device), **facts, "scenes": rows}, options.output)


if __name__ == "__main__":
    main(sys.argv[1:])
