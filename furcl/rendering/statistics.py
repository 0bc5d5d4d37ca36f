"""What a render says about itself."""

from __future__ import annotations

import dataclasses
import resource
from typing import TYPE_CHECKING, Any

from furcl.bvh.build import BUFFERS
from furcl.rendering.specialise import left_out
from furcl.version import software

if TYPE_CHECKING:
    from furcl.rendering.renderer import Renderer


def statistics(renderer: Renderer) -> dict[str, Any]:
    """What `--stats` writes; times in seconds, sizes in bytes."""
    render = renderer.seconds.get("render", 0.0)
    lobes = renderer.lobes
    return {
        **software(),
        "scene": renderer.scene.name,
        "environment_pixels_clamped": renderer.setup.n_negative,
        "device": renderer.device.name,
        "platform": renderer.device.platform,
        "driver": renderer.device.driver_version,
        "seed": renderer.scene.render.seed,
        "first_sample": renderer.first_sample,
        "spp": renderer.samples_done,
        "sampling": renderer.scene.render.sampling,
        "sequence": renderer.features.sequence,
        "allocation": renderer.scene.render.allocation,
        "steps": renderer.plan.steps if renderer.plan else 1,
        "width": renderer.film.width,
        "height": renderer.film.height,
        **({} if renderer.window.whole else {"crop": list(renderer.window.box)}),
        "transparent": renderer.features.transparent,
        "segments": renderer.setup.geometry.tree.n_segments,
        "features": {
            "compiled": renderer.material.features.as_dict(),
            "left_out": left_out(renderer.material),
        },
        "seconds": dict(renderer.seconds),
        "paths": renderer.paths_done,
        "rays": renderer.rays,
        "mrays_s": renderer.rays / render / 1e6 if render else 0.0,
        "path_length": (renderer.rays - renderer.shadow_rays) / max(renderer.paths_done, 1),
        "hits_per_path": sum(lobes.values()) / max(renderer.paths_done, 1),
        "lobes": lobes,
        "grooms": [dataclasses.asdict(groom) for groom in renderer.setup.grooms],
        "materials": _of_materials(renderer),
        "nonfinite": renderer.film.read_nonfinite(renderer.memory),
        "bytes": {
            "host_peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
            "device_peak": renderer.memory.peak_bytes,
            "bvh": sum(map(renderer.memory.held, BUFFERS)),
            "tables": renderer.memory.held("material"),
            "absorption": renderer.memory.held("absorption"),
        },
        "wave_size": renderer.wave_size.paths,
        "wave_size_from": renderer.wave_size.origin,
    }


def _of_materials(renderer: Renderer) -> list[dict[str, Any]]:
    """Statistics of each fibre material."""
    rows = zip(
        renderer.materials, renderer.material_hits.tolist(), renderer.lobe_counts, strict=True
    )
    return [
        {
            "name": material.name,
            "hits": hits,
            "lobes": dict(zip(material.lobes, lobes.tolist(), strict=True)),
            "features": {
                "compiled": material.features.as_dict(),
                "left_out": left_out(material),
            },
        }
        for material, hits, lobes in rows
    ]
