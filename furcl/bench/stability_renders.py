"""Stiff scenes (scenes/extreme): are their pictures finite, and right?

Some pixels are rendered again in float64 on the host; device and host agree if no pixel and channel
differs by more than chance explains (z-tests, Sidak's correction over all of them). Each row says
which bias that would have shown.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from furcl.device.choice import Device
from furcl.fibre.double_cylinder.reference import UNSCATTERED
from furcl.oracle.host_render import HostRenderer
from furcl.paths import scene_folder
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene

Array = NDArray[np.float64]

ALPHA = 1e-3
"""Chance that right renders of all scenes are called wrong."""

POWER = 0.8
"""Chance that a bias of the size which a row gives is seen."""

ENOUGH = 0.04
"""Standard error of a pixel over its value at which the host stops adding paths, ..."""

MOST_BATCHES = 32
"""... after this many times the paths asked for at the latest."""

SIZE = "8x8"
PIXELS = ((2, 3), (3, 4), (4, 3), (5, 5))
QUICK = ("near_specular", "kappa_0_999", "far_away", "one_strand")


def scene_files() -> list[Path]:
    """The scenes of scenes/extreme, in the order of their names."""
    return sorted((scene_folder() / "extreme").glob("*.toml"))


def scenes(quick: bool) -> list[Path]:
    """Those of them that a sweep renders."""
    return [path for path in scene_files() if not quick or path.stem in QUICK]


def settle(rows: list[dict[str, Any]]) -> None:
    """Say of the rows of all scenes, each as `render_row` makes it, whether it `agrees`."""
    level = 1.0 - (1.0 - ALPHA) ** (1.0 / max(len(rows), 1))
    for row in rows:
        row["agrees"] = bool(row["p"] > level)


def render_row(path: Path, device: Device, spp: int, paths: int, seed: int = 7) -> dict[str, Any]:
    """Render a scene on the device and four of its pixels on the host.

    Returns
    -------
    dict    `paths` of the host for the pixel that took most; `largest` pixel value, `nonfinite`
            samples, `energy` (mean of the picture), `hits` a path, `device` and `host` means of
            the pixels with standard errors, and `p`: the smallest p-value of the pixels and
            channels, corrected for their number; `detects`: the smallest bias of the whole
            picture, relative, that is seen with chance POWER
    """
    scene = load_scene(path, size=SIZE, spp=spp, seed=seed)
    start = time.perf_counter()
    renderer = Renderer(scene, device)
    renderer.advance(spp)
    image = renderer.image()
    # A render leaves out scattered lobes that carry next to nothing, and the profiles with them.
    host = HostRenderer(scene, renderer.material.profiles or UNSCATTERED)
    rng = np.random.default_rng(seed)
    rows, gots, means, spreads, most_paths = [], [], [], [], 0
    assert image.variance is not None
    variances = image.variance.astype(np.float64)
    for x, y in PIXELS:
        mean, variance, used = _host_pixel(host, x, y, paths, rng)
        got = image.rgb[y, x].astype(np.float64)
        spread = np.sqrt(variance + variances[y, x])
        for values, value in ((gots, got), (means, mean), (spreads, spread)):
            values.append(value)
        most_paths = max(most_paths, used)
        rows.append({"pixel": [x, y], "device": got.tolist(), "host": mean.tolist(),
                     "standard_error": spread.tolist()})  # fmt: skip
    gots, means, spreads = with_average(*(np.array(x) for x in (gots, means, spreads)))
    found = renderer.stats()
    return {
        "scene": path.stem,
        "spp": spp,
        "paths": most_paths,
        "largest": float(image.rgb.max()),
        "nonfinite": int(found["nonfinite"]),
        "energy": float(image.rgb.mean(dtype=np.float64)),
        "hits": found["hits_per_path"],
        "pixels": rows,
        "p": p_value(gots, means, spreads),
        "detects": detectable(means, spreads),
        "seconds": time.perf_counter() - start,
    }


def _host_pixel(host: HostRenderer, x: int, y: int, paths: int, rng: np.random.Generator):
    """Mean (3,), its variance, and the paths that it took."""
    sums, squares, n = np.zeros(3), np.zeros(3), 0
    while n < MOST_BATCHES and (not n or np.any(np.sqrt(squares) > ENOUGH * sums)):
        mean, variance = host.pixel(x, y, paths, rng)
        sums, squares, n = sums + mean, squares + variance, n + 1
    return sums / n, squares / n**2, n * paths


def with_average(got: Array, mean: Array, spread: Array) -> tuple[Array, Array, Array]:
    """The pixels (n, 3) and, as one more, their average, which has the smallest error."""
    errors = np.sqrt(np.sum(spread**2, axis=0)) / len(spread)
    return (
        np.vstack([got, got.mean(axis=0)]),
        np.vstack([mean, mean.mean(axis=0)]),
        np.vstack([spread, errors]),
    )


def p_value(got: Array, mean: Array, spread: Array) -> float:
    """Of the hypothesis that `got` (n, 3) are estimates of `mean` with standard errors `spread`."""
    # Float32 sums are exact to about 1e-6; a white picture has no variance at all.
    z = np.maximum(np.abs(got - mean) - 2e-5 * mean, 0.0) / np.maximum(spread, 1e-30)
    return float(1.0 - (1.0 - np.min(2.0 * stats.norm.sf(z))) ** np.size(z))


def detectable(mean: Array, spread: Array) -> float:
    """The smallest relative bias that makes a `p_value` too small with chance POWER, scenes being
    as many as there are; from the pixel and channel that shows it best."""
    level = 1.0 - (1.0 - ALPHA) ** (1.0 / (len(scene_files()) * np.size(mean)))
    needed = stats.norm.isf(0.5 * level) + stats.norm.isf(1.0 - POWER)
    seen = np.divide(needed * spread, mean, out=np.full_like(mean, np.inf), where=mean > 0.0)
    return float(np.min(seen) + 2e-5)
