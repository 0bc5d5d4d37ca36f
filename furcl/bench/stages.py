"""`furcl bench stages`: where the time of a render goes, kernel by kernel."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.rendering.renderer import Renderer
from furcl.rendering.wavefront import RAY_STAGES
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)

# What a stage works on; the counts of a round hold a number for each.
ITEMS = {
    "generate": "paths",
    "intersect_closest": "closest_rays",
    "shade_escaped": "misses",
    "sample_lobe_h": "fibre_hits",
    "shade": "fibre_hits",
    "shade_surface": "surface_hits",
    "intersect_shadow": "shadow_rays",
    "learn": "recorded_paths",
    "add_to_film": "paths",
}


def run(
    scenes: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    device: str | Device | None = None,
    spp: int = 8,
    rounds: int = 1,
    wave_size: int | None = None,
    overrides: Iterable[str] = (),
) -> dict[str, Any]:
    """Render scenes and time every kernel by OpenCL's own events.

    Kernels are compiled and the wave size is found before the clock starts. Of several rounds of
    `spp` samples, the one of median time is reported. Writes results.json to `out`.

    Returns
    -------
    dict    `scenes`: what `measure` returns for each

    Raises
    ------
    SceneError, GroomError, DeviceError and what else a render raises
    """
    opened = device if isinstance(device, Device) else open_device(device)
    overrides = list(overrides)
    rows = []
    for path in scenes:
        scene = load_scene(path, overrides=overrides)
        log.info("%s", scene.name)
        rows.append(measure(scene, opened, spp, rounds, wave_size))
    results = {**circumstances(opened), "spp": spp, "rounds": rounds, "scenes": rows}
    write_json(results, Path(out) / "results.json")
    return results


def measure(
    scene: Scene, device: Device, spp: int, rounds: int = 1, wave_size: int | None = None
) -> dict[str, Any]:
    """Time the stages of one scene.

    Returns
    -------
    dict    `stages`: per kernel launches, ms, share of the time in kernels, a rate in million
            items a second, `wall_seconds`;
            `launch_overhead`: share of the wall time in which no kernel runs; `mrays_s`,
            `mpaths_s` of the render; `intersect_mrays_s`: the same rays over the time of the
            intersect kernels alone; `end_to_end`: the first over the second; `cores_busy`:
            processor seconds of this process over wall seconds, None on GPUs
    """
    renderer = Renderer(scene, device, wave_size)
    renderer.advance(1)
    found = sorted(
        (timed_round(renderer, spp) for _ in range(rounds)), key=lambda r: r["wall_seconds"]
    )
    return {
        "scene": scene.name,
        "segments": renderer.setup.geometry.tree.n_segments,
        "size": [scene.film.width, scene.film.height],
        "wave_size": renderer.wave_size.paths,
        "wave_size_from": renderer.wave_size.origin,
        "features": renderer.material.features.as_dict(),
        "compile_seconds": renderer.seconds["compile"],
        **found[len(found) // 2],
    }


def _counts(renderer: Renderer) -> dict[str, int]:
    learning = renderer.setup.learning
    return {
        "paths": renderer.paths_done,
        "recorded_paths": min(renderer.paths_done, learning.recorded) if learning else 0,
        "rays": renderer.rays,
        "closest_rays": renderer.rays - renderer.shadow_rays,
        "shadow_rays": renderer.shadow_rays,
        "fibre_hits": renderer.hits - renderer.surface_hits,
        "surface_hits": renderer.surface_hits,
        "hits": renderer.hits,
        "misses": renderer.misses,
    }


def timed_round(renderer: Renderer, spp: int) -> dict[str, Any]:
    """Time, counts and rates of `spp` more samples; a part of what `measure` returns."""
    wavefront, before = renderer.wavefront, _counts(renderer)
    wavefront.events.clear()
    wavefront.keep_events = True
    start, cpu = time.perf_counter(), time.process_time()
    renderer.advance(spp)
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    counted = {name: number - before[name] for name, number in _counts(renderer).items()}
    stages = _stage_rows(wavefront.events, counted)
    tracing = sum(row["ms"] for row in stages if row["stage"] in RAY_STAGES) / 1e3
    return {
        **counted,
        "wall_seconds": wall,
        "launch_overhead": 1.0 - sum(row["ms"] for row in stages) / 1e3 / wall,
        "mrays_s": counted["rays"] / wall / 1e6,
        "mpaths_s": counted["paths"] / wall / 1e6,
        "intersect_mrays_s": counted["rays"] / tracing / 1e6,
        "end_to_end": tracing / wall,
        "cores_busy": cpu / wall if renderer.device.is_cpu else None,
        "stages": stages,
    }


def _stage_rows(events: dict[str, list[Any]], counted: dict[str, int]) -> list[dict[str, Any]]:
    rows = []
    for stage, launches in events.items():
        ms = sum(e.profile.end - e.profile.start for e in launches) / 1e6
        items = counted[ITEMS[stage]]
        rows.append(
            {
                "stage": stage,
                "launches": len(launches),
                "ms": ms,
                "counts": ITEMS[stage],
                "million_per_second": items / ms / 1e3 if ms else 0.0,
            }
        )
    total = sum(row["ms"] for row in rows)
    for row in rows:
        row["share"] = row["ms"] / total
    return rows
