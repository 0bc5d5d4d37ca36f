"""`furcl bench waves`: how fast renders are by the size of their waves."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.render.renderer import Renderer
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)


def run(
    scenes: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    sizes: Sequence[int],
    device: str | Device | None = None,
    spp: int = 1,
    rounds: int = 7,
    overrides: Iterable[str] = (),
) -> dict[str, Any]:
    """Render scenes with waves of fixed sizes and of the size that a probe chooses.

    Rounds of `spp` samples alternate between the sizes, so that a machine whose speed drifts treats
    all alike. Writes results.json to `out`.

    Parameters
    ----------
    sizes : sequence of int     [paths]; the others are compared with the first

    Returns
    -------
    dict    `scenes`: for each the wave size `chosen`, where it is `chosen_from`, and `rows`: size
            [paths] or "chosen", median `mpaths_s`, and `ratio`, the median over the rounds of the
            first size's time over this one's
    """
    opened = device if isinstance(device, Device) else open_device(device)
    overrides = list(overrides)
    results = {
        **circumstances(opened),
        "spp": spp,
        "rounds": rounds,
        "scenes": [
            _compare(load_scene(path, overrides=overrides), opened, sizes, spp, rounds)
            for path in scenes
        ],
    }
    write_json(results, Path(out) / "results.json")
    return results


def _compare(
    scene: Scene, device: Device, sizes: Sequence[int], spp: int, rounds: int
) -> dict[str, Any]:
    log.info("%s", scene.name)
    renderers = {size: Renderer(scene, device, size) for size in (*sizes, None)}
    for renderer in renderers.values():
        renderer.advance(1)
        renderer.settle()
    seconds: dict[int | None, list[float]] = {size: [] for size in renderers}
    for _ in range(rounds):
        for size, renderer in renderers.items():
            start = time.perf_counter()
            renderer.advance(spp)
            seconds[size].append(time.perf_counter() - start)
    chosen = renderers[None]
    first = np.array(seconds[sizes[0]])
    paths = spp * chosen.n_pixels
    rows = [
        {
            "size": size or "chosen",
            "mpaths_s": paths / float(np.median(times)) / 1e6,
            "ratio": float(np.median(first / np.array(times))),
        }
        for size, times in seconds.items()
    ]
    return {
        "scene": scene.name,
        "chosen": chosen.wave_size.paths,
        "chosen_from": chosen.wave_size.origin,
        "rows": rows,
    }
