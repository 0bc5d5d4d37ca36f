"""`furcl bench stages`: where the time of a render goes, kernel by kernel."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from furcl.bench.record import circumstances, write_json
from furcl.device import Device, open_device
from furcl.integrator import Renderer
from furcl.scene_io import load_scene

WARM_UP_SPP = 1


def run(
    scene_path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    device: str | Device | None = None,
    spp: int = 8,
    overrides: Iterable[str] = (),
) -> dict[str, Any]:
    """Render a scene and time every kernel by OpenCL's own events.

    Compilation is over before the clock starts: one sample a pixel is rendered first. Writes
    results.json to `out`.

    Returns
    -------
    dict    `stages`: per kernel launches, ms, share of the time in kernels, and a rate in million
            paths or rays a second; `wall_seconds`; `busy`: time in kernels over wall time

    Raises
    ------
    SceneError, GroomError, DeviceError and what else a render raises
    """
    scene = load_scene(scene_path, overrides=overrides)
    renderer = Renderer(scene, device if isinstance(device, Device) else open_device(device))
    renderer.advance(WARM_UP_SPP)
    paths, rays, hits = renderer.paths_done, renderer.rays, int(renderer.lobe_counts.sum())
    wavefront = renderer.wavefront
    wavefront.keep_events = True
    start = time.perf_counter()
    renderer.advance(spp)
    wall = time.perf_counter() - start
    counted = {
        "paths": renderer.paths_done - paths,
        "rays": renderer.rays - rays,
        "fibre_hits": int(renderer.lobe_counts.sum()) - hits,
    }
    stages = _stage_rows(wavefront.events, counted)
    results = {
        **circumstances(renderer.device),
        "scene": scene.name,
        "spp": spp,
        "wave_size": renderer.wave_size.paths,
        "features": renderer.features.as_dict(),
        "compile_seconds": renderer.seconds["compile"],
        **counted,
        "wall_seconds": wall,
        "busy": sum(row["ms"] for row in stages) / 1e3 / wall,
        "mrays_s": counted["rays"] / wall / 1e6,
        "mpaths_s": counted["paths"] / wall / 1e6,
        "stages": stages,
    }
    write_json(results, Path(out) / "results.json")
    return results


# What a kernel's rate counts.
_WORK = {
    "generate": "paths",
    "intersect_closest": "rays",
    "intersect_shadow": "rays",
    "shade_escaped": "paths",
    "sample_lobe_h": "fibre_hits",
    "shade": "fibre_hits",
    "add_to_film": "paths",
}


def _stage_rows(events: dict, counted: dict[str, int]) -> list[dict[str, Any]]:
    rows = []
    for stage, launches in events.items():
        ms = sum(e.profile.end - e.profile.start for e in launches) / 1e6
        rows.append({"stage": stage, "launches": len(launches), "ms": ms, "counts": _WORK[stage]})
    total = sum(row["ms"] for row in rows)
    # Closest and shadow rays are counted together, so their kernels share one rate.
    tracing = sum(row["ms"] for row in rows if row["counts"] == "rays")
    for row in rows:
        ms = tracing if row["counts"] == "rays" else row["ms"]
        row["share"] = row["ms"] / total
        row["million_per_second"] = counted[row["counts"]] / ms / 1e3 if ms else 0.0
    return rows
