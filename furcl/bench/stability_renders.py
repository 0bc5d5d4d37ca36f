"""Stiff scenes (scenes/extreme): are their pictures finite, and right?

Some pixels are rendered again in float64 on the host; device and host agree if no pixel and channel
differs by more than chance explains (z-tests, Sidak's correction over all of them).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from furcl.bench.host_render import HostRenderer
from furcl.device import Device
from furcl.integrator import Renderer
from furcl.paths import scene_folder
from furcl.scene_io import load_scene

ALPHA = 1e-3
"""Chance that right renders of all scenes are called wrong."""

SIZE = "8x8"
PIXELS = ((2, 3), (3, 4), (4, 3), (5, 5))
QUICK = ("near_specular", "kappa_0_999", "far_away", "one_strand")


def scene_files() -> list[Path]:
    """The scenes of scenes/extreme, in the order of their names."""
    return sorted((scene_folder() / "extreme").glob("*.toml"))


def render_rows(
    device: Device, quick: bool, say: Callable[[str, int, int], None]
) -> list[dict[str, Any]]:
    """One row for each scene: see `render_row`."""
    files = [path for path in scene_files() if not quick or path.stem in QUICK]
    rows = []
    for i, path in enumerate(files):
        rows.append(
            render_row(path, device, spp=64 if quick else 512, paths=600 if quick else 4000)
        )
        say("renders", i + 1, len(files))
    level = 1.0 - (1.0 - ALPHA) ** (1.0 / max(len(rows), 1))
    for row in rows:
        row["agrees"] = bool(row["p"] > level)
    return rows


def render_row(path: Path, device: Device, spp: int, paths: int, seed: int = 7) -> dict[str, Any]:
    """Render a scene on the device and four of its pixels on the host.

    Returns
    -------
    dict    `largest` pixel value, `nonfinite` samples, `energy` (mean of the picture), `hits` a
            path, `device` and `host` means of the pixels with standard errors, and `p`: the
            smallest p-value of the pixels and channels, corrected for their number
    """
    scene = load_scene(path, size=SIZE, spp=spp, seed=seed)
    start = time.perf_counter()
    renderer = Renderer(scene, device)
    renderer.advance(spp)
    image = renderer.image()
    host = HostRenderer(scene, renderer.material.profiles)
    rng = np.random.default_rng(seed)
    rows, p_values = [], []
    assert image.variance is not None
    variances = image.variance.astype(np.float64)
    for x, y in PIXELS:
        mean, variance = host.pixel(x, y, paths, rng)
        got = image.rgb[y, x].astype(np.float64)
        spread = np.sqrt(variance + variances[y, x])
        # Float32 sums are exact to about 1e-6; a white picture has no variance at all.
        z = np.maximum(np.abs(got - mean) - 2e-5 * mean, 0.0) / np.maximum(spread, 1e-30)
        p_values.append(2.0 * stats.norm.sf(z))
        rows.append({"pixel": [x, y], "device": got.tolist(), "host": mean.tolist(),
                     "standard_error": spread.tolist()})  # fmt: skip
    p = np.min(p_values)
    found = renderer.stats()
    return {
        "scene": path.stem,
        "spp": spp,
        "paths": paths,
        "largest": float(image.rgb.max()),
        "nonfinite": int(found["nonfinite"]),
        "energy": float(image.rgb.mean(dtype=np.float64)),
        "hits": found["hits_per_path"],
        "pixels": rows,
        "p": float(1.0 - (1.0 - p) ** np.size(p_values)),
        "seconds": time.perf_counter() - start,
    }
