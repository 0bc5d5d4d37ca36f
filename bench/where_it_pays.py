"""Where the sampler of Shibaike and Iwasaki pays: RMSE of attenuation-cdf over that of uniform-h at
equal samples, over density, absorption and light.

python bench/where_it_pays.py [-o FOLDER] [--device D] [--quick] [--show]

The hair of scenes/black_hair.toml with other numbers of strands, absorptions and lights, in front
of nothing (the light behind it is not seen), with and without light samples. A run that was stopped
goes on where it stopped; FOLDER/results.json is written after every cell, and says of every run
how many cells are its own. --show prints the cells of one that is there.
`python bench/where_it_pays_tables.py` draws the figure.
"""

from __future__ import annotations

import argparse
import itertools
import json
import logging
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tables import FOLDER

from furcl.bench.convergence_statistics import Estimate, mean_interval
from furcl.bench.record import circumstances, write_json
from furcl.bench.variance import prepared
from furcl.device.choice import Device, open_device
from furcl.groom.joined import Grooms
from furcl.rendering.held import Held
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)

Array = NDArray[np.float64]
Cell = dict[str, Any]

SCENE = "black_hair"
SAMPLERS = ("uniform-h", "attenuation-cdf")
STRANDS = (30, 300, 3_000, 10_000, 30_000, 100_000)
ABSORPTIONS = (0.05, 0.41, 4.1, 20.0)  # sigma_ca, over the radius
SUNS = (60.0, 10.0, 0.53)  # angle of the disk [deg]
SIDES = ("front", "side", "back")
LIGHT_SAMPLING = ("bcsdf", "mis")
EVEN = ("even", 0.0)
# These densities stand in these lights alone: the trees of the densest hair take long.
FEWER = (10_000, 100_000)
FEWER_IN = (EVEN, *((side, 10.0) for side in SIDES))
# Of a scene with a sun half of the light comes from it; it stands so high over the horizon.
SUN_SHARE, SUN_ELEVATION_DEG = 0.5, 30.0

SIZE, GROUPS, SAMPLES = "32x32", 48, 8
SETTINGS = (
    "curves.n_points=9",  # straight hair needs no more, and trees of many strands are built faster
    "film.background=transparent",
    "render.roulette=depth",
    "render.roulette_depth=8",
)


def cells() -> Iterator[Cell]:
    """Every cell: light, angle of the sun, strands, absorption; lights and densities together."""
    lights = [EVEN, *itertools.product(SIDES, SUNS)]
    for n_strands, (light, angle) in itertools.product(STRANDS, lights):
        if n_strands in FEWER and (light, angle) not in FEWER_IN:
            continue
        for sigma in ABSORPTIONS:
            yield {"light": light, "angle_deg": angle, "strands": n_strands, "sigma_ca": sigma}


def light_settings(cell: Cell, scene: Scene, grooms: Grooms) -> list[str]:
    """Overrides that light a scene: evenly, and by a sun, seen from the camera in front, to the
    right, or behind the hair."""
    if cell["light"] == "even":
        return ['environment={kind="constant",radiance=1.0}']
    _, right, _, forward = scene.resolved_camera(grooms.curves).frame()
    towards = {"front": -forward, "side": right, "back": forward}[cell["light"]].copy()
    towards[2] = 0.0
    elevation = np.radians(SUN_ELEVATION_DEG)
    towards *= np.cos(elevation) / np.linalg.norm(towards)
    towards[2] = np.sin(elevation)
    target = ",".join(f"{-x:.9f}" for x in towards)
    sun = (
        f'kind="distant",target=[{target}],angle_deg={cell["angle_deg"]},'
        f"irradiance={4.0 * np.pi * SUN_SHARE}"
    )
    even = f'kind="constant",radiance={1.0 - SUN_SHARE}'
    return [f"environment={{{even}}}", f"lamp={{sun={{{sun}}}}}"]


def measured(
    scene: Scene, device: Device, grooms: Grooms, groups: int
) -> tuple[Array, Array, float]:
    """Variance of a sample within groups that share the camera's numbers, (groups,), means of these
    groups, (groups, values), and rays a path."""
    renderer = Renderer(scene, device, held=Held(camera=True), curves=grooms)
    within, means = np.zeros(groups), []
    for group in range(groups):
        renderer.empty_film(1 + group)
        renderer.advance(SAMPLES)
        mean, variance, _ = renderer.film.read(renderer.memory)
        within[group] = SAMPLES * variance.mean(dtype=np.float64)
        means.append(mean.ravel().astype(np.float64))
    return within, np.array(means), renderer.rays / renderer.paths_done


def log_ratios(
    within: list[Array], means: list[Array], keep: NDArray[np.intp]
) -> tuple[float, float]:
    """Logarithms of the ratio of RMSE, second over first: of paths, and whole, of some groups.

    What the camera's numbers decide is the same for both: the mean of two estimates by analysis of
    variance, that between groups less what is within them.
    """
    paths = [w[keep].mean() for w in within]
    camera = np.mean(
        [
            m[keep].var(axis=0, ddof=1).mean() - p / SAMPLES
            for m, p in zip(means, paths, strict=True)
        ]
    )
    camera = max(float(camera), 0.0)
    if not min(paths) > 0.0:
        return float("nan"), float("nan")
    whole = [p + camera for p in paths]
    return 0.5 * float(np.log(paths[1] / paths[0])), 0.5 * float(np.log(whole[1] / whole[0]))


def compared(within: list[Array], means: list[Array]) -> dict[str, Any]:
    """Both ratios with 95 % intervals, by the jackknife over groups and Student's t."""
    n = len(within[0])
    every = np.arange(n)
    whole = np.array(log_ratios(within, means, every))
    without = np.array([log_ratios(within, means, every[every != k]) for k in every])
    found = {}
    for name, values in zip(("path_rmse", "rmse"), (n * whole - (n - 1) * without).T, strict=True):
        e = mean_interval(values)
        mean, low, high = (float(np.exp(x)) for x in (e.mean, e.low, e.high))
        found[name] = Estimate(mean, low, high, n).as_dict()
    return found


def measure_cell(
    cell: Cell,
    device: Device,
    groups: int,
    size: str,
    grooms: Grooms | None = None,
    settings: Iterable[str] = (),
) -> Cell:
    """A cell with what was measured in it, with and without light samples."""
    base = load_scene(SCENE, overrides=[*of_cell(cell), *settings], size=size)
    grooms = grooms or base.build_grooms()
    lit = with_overrides(base, light_settings(cell, base, grooms))
    found: Cell = dict(cell)
    for light_sampling in LIGHT_SAMPLING:
        start = time.perf_counter()
        within, means, rays = [], [], []
        for sampler in SAMPLERS:
            keys = [f"render.sampling={sampler}", f"render.light_sampling={light_sampling}"]
            scene = prepared(lit, keys)
            of_groups, of_means, of_path = measured(scene, device, grooms, groups)
            within.append(of_groups)
            means.append(of_means)
            rays.append(of_path)
        found[light_sampling] = {
            **compared(within, means),
            "path_variance": [float(w.mean()) for w in within],
            "radiance": [float(m.mean()) for m in means],
            "rays_per_path": rays,
            "seconds": time.perf_counter() - start,
        }
    return found


def of_cell(cell: Cell) -> list[str]:
    """Overrides that all samplers have."""
    return [
        *SETTINGS,
        f"curves.n_strands={cell['strands']}",
        f"fibre.sigma_ca={cell['sigma_ca']}",
    ]


def run(out: Path, device: Device, *, quick: bool = False) -> dict[str, Any]:
    """Measure all cells that out/results.json does not hold; each is kept there at once."""
    path = out / "results.json"
    groups, size = (3, "8x8") if quick else (GROUPS, SIZE)
    numbers = {"size": size, "groups": groups, "samples": SAMPLES}
    rows: list[Cell] = []
    earlier: list[dict[str, Any]] = []
    if path.is_file():
        before = json.loads(path.read_text())
        if {key: before.get(key) for key in numbers} != numbers:
            raise SystemExit(
                f"{path}: of other sizes or samples; move it away, or choose another -o"
            )
        rows, earlier = before["cells"], before["runs"]
    own = {**circumstances(device), "measured": 0}
    wanted = [cell for cell in cells() if not quick or cell["strands"] <= STRANDS[1]]
    done = [{key: row[key] for key in wanted[0]} for row in rows]
    grooms: tuple[int, Grooms | None] = (0, None)
    for cell in wanted:
        if cell in done:
            continue
        if grooms[0] != cell["strands"]:
            scene = load_scene(SCENE, overrides=of_cell(cell), size=size)
            grooms = (cell["strands"], scene.build_grooms())
        rows.append(measure_cell(cell, device, groups, size, grooms[1]))
        own["measured"] += 1
        results = {"runs": [*earlier, own], **numbers, "samplers": list(SAMPLERS), "cells": rows}
        write_json(results, path)
        print(shown(rows[-1]), flush=True)
    return json.loads(path.read_text())


def shown(row: Cell) -> str:
    """A cell as a line."""
    where = f"{row['light']:>5} {row['angle_deg']:5g} {row['strands']:7d} {row['sigma_ca']:6g}"
    return where + "".join(
        f" | {kind} path {_interval(row[kind]['path_rmse'])} whole {_interval(row[kind]['rmse'])}"
        for kind in LIGHT_SAMPLING
    )


def _interval(found: dict[str, Any]) -> str:
    if found["mean"] is None:
        return "-"
    return f"{found['mean']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"


def main() -> None:
    summary, _, rest = (__doc__ or "").partition("\n\n")
    parser = argparse.ArgumentParser(description=f"{summary} {rest}")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER / "where_it_pays")
    parser.add_argument("--device", default=None)
    parser.add_argument("--quick", action="store_true", help="few and small, to try the script")
    parser.add_argument("--show", action="store_true", help="print what was measured")
    options = parser.parse_args()
    if options.show:
        for row in json.loads((options.output / "results.json").read_text())["cells"]:
            print(shown(row))
        return
    run(options.output, open_device(options.device), quick=options.quick)


if __name__ == "__main__":
    main()
