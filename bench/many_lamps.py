"""Noise and time of many small lamps against one: python bench/many_lamps.py [--spp 64].

A patch of fur in the light of a square lamp, of 64 lamps that are its pieces, of such pieces all
around it, and of small ones close above it; lamps are chosen by position and by power. Printed are
the mean squared error over the squared mean, and the processor time, over those of the one lamp.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

import furcl
from furcl.device.choice import Device
from furcl.scene.read import decode_scene
from furcl.scene.tables import Scene

SIDE = 8
"""Lamps along a side of the square."""

PLACE = np.array([0.0, -1.5, 1.5])
"""Middle of the square, which looks at the origin."""


def _quad(position: np.ndarray, size: float, target: np.ndarray) -> dict[str, Any]:
    return {
        "kind": "quad", "position": position.tolist(), "target": target.tolist(),
        "size": [size, size], "radiance": 3.0,
    }  # fmt: skip


def one() -> dict[str, Any]:
    """A square of side 1."""
    return {"key": _quad(PLACE, 1.0, np.zeros(3))}


def pieces() -> dict[str, Any]:
    """The same square in pieces."""
    across, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.5, 0.5]) * 2.0**0.5
    lamps = {}
    for i in range(SIDE**2):
        x, y = (np.array(divmod(i, SIDE)) + 0.5) / SIDE - 0.5
        place = PLACE + x * across + y * up
        lamps[f"lamp{i}"] = _quad(place, 1.0 / SIDE, place - PLACE)
    return lamps


def around(distance: float, seed: int = 2) -> dict[str, Any]:
    """Pieces of the same size at random places of a dome of that radius."""
    rng = np.random.default_rng(seed)
    lamps = {}
    for i in range(SIDE**2):
        way = rng.normal(size=3)
        way[2] = abs(way[2]) + 0.3
        lamps[f"lamp{i}"] = _quad(distance * way / np.linalg.norm(way), 1.0 / SIDE, np.zeros(3))
    return lamps


def ceiling(height: float) -> dict[str, Any]:
    """Pieces at even places over the whole patch, that look down."""
    lamps = {}
    for i in range(SIDE**2):
        x, y = (np.array(divmod(i, SIDE)) + 0.5) / SIDE - 0.5
        place = np.array([x, y, height])
        lamps[f"lamp{i}"] = _quad(place, 0.2 / SIDE, place - [0.0, 0.0, 1.0])
    return lamps


LAMPS = {
    "one": one(),
    "its pieces": pieces(),
    "around, far": around(2.1),
    "ceiling": ceiling(0.4),
}


def patch(lamps: dict[str, Any], spp: int, size: int, choice: str = "position") -> Scene:
    """A patch of fur in the light of lamps, at samples whose variance says the error."""
    return decode_scene(
        {
            "name": "many lamps",
            "film": {"width": size, "height": size * 2 // 3},
            "camera": {"azimuth_deg": -60.0, "elevation_deg": 40.0},
            "fibre": {"preset": "red-fox"},
            "lamp": lamps,
            "curves": {
                "generator": "fur", "surface": "patch", "patch_size": [1.0, 1.0],
                "n_strands": 300, "length": 0.3, "radius": 0.01,
            },
            "render": {
                "spp": spp, "lamp_choice": choice, "sequence": "independent",
                "roulette": "depth",
            },
        }
    )  # fmt: skip


def relative_error(scene: Scene, device: Device | str | None) -> tuple[float, float]:
    """Mean squared error of a picture over its squared mean, and processor time [s]."""
    start = time.process_time()
    image = furcl.render(scene, device=device)
    seconds = time.process_time() - start
    assert image.variance is not None
    error = image.variance.mean(dtype=np.float64) / image.rgb.mean(dtype=np.float64) ** 2
    return float(error), seconds


def ratios(spp: int, size: int, device: Device | str | None) -> Iterator[tuple[str, float, float]]:
    """What is compared, its error and its time, over those of the one lamp."""
    base = None
    for name, lamps in LAMPS.items():
        for choice in ("position", "power") if len(lamps) > 1 else ("position",):
            scene = patch(lamps, spp, size, choice)
            relative_error(patch(lamps, 1, size, choice), device)  # compiles
            error, seconds = relative_error(scene, device)
            base = base or (error, seconds)
            yield f"{name}, by {choice}", error / base[0], seconds / base[1]


def main() -> None:
    """Prints a line for each scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--size", type=int, default=48)
    parser.add_argument("--device")
    options = parser.parse_args()
    print(f"{'lamps':28} {'error':>7} {'time':>7}")
    for name, error, seconds in ratios(options.spp, options.size, options.device):
        print(f"{name:28} {error:7.2f} {seconds:7.2f}")


if __name__ == "__main__":
    main()
