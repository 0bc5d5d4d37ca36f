"""`furcl bench waves`: how fast renders are by the size of their waves."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.pairs import in_turns, median_interval
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene


def run(
    scenes: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    sizes: Sequence[int],
    device: str | Device | None = None,
    spp: int = 4,
    rounds: int = 11,
    overrides: Iterable[str] = (),
) -> dict[str, Any]:
    """Render scenes with waves of given sizes [paths], which take turns of `spp` samples.

    Writes results.json to `out`.

    Returns
    -------
    dict    `scenes`: for each `rows`: size [paths], median `mpaths_s`, and medians over the rounds
            of the first size's seconds over this one's, with intervals: `ratio` of wall seconds and
            `cpu_ratio` of processor seconds (None on GPUs)
    """
    opened = device if isinstance(device, Device) else open_device(device)
    overrides = list(overrides)
    found = [load_scene(path, overrides=overrides) for path in scenes]
    rows = [{"scene": s.name, "rows": _compare(s, opened, sizes, spp, rounds)} for s in found]
    results = {**circumstances(opened), "spp": spp, "rounds": rounds, "scenes": rows}
    write_json(results, Path(out) / "results.json")
    return results


def _compare(
    scene: Scene, device: Device, sizes: Sequence[int], spp: int, rounds: int
) -> list[dict[str, Any]]:
    renderers = {size: Renderer(scene, device, size) for size in sizes}
    for renderer in renderers.values():
        renderer.advance(1)
    turns = in_turns({s: partial(r.advance, spp) for s, r in renderers.items()}, rounds)
    first, n_paths = turns[sizes[0]], spp * renderers[sizes[0]].n_pixels
    return [
        {
            "size": size,
            "mpaths_s": n_paths / float(np.median(took.wall)) / 1e6,
            "ratio": asdict(median_interval(first.wall / took.wall)),
            "cpu_ratio": asdict(median_interval(first.cpu / took.cpu)) if device.is_cpu else None,
        }
        for size, took in turns.items()
    ]
