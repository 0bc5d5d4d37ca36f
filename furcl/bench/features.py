"""`furcl bench features`: what leaving out buys, scene by scene."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.pairs import in_turns
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.image.image import Image
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene, with_overrides

log = logging.getLogger(__name__)

BUILDS = ("specialised", "everything-on")


def run(
    scenes: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    device: str | Device | None = None,
    size: str = "128x128",
    spp: int = 4,
    rounds: int = 5,
    overrides: Iterable[str] = (),
) -> dict[str, Any]:
    """Render scenes by the specialised and the everything-on build and compare.

    Rounds of `spp` samples of the two builds alternate, so that a machine whose speed drifts
    treats both alike; the ratio of times is the median of the rounds' ratios. Writes results.json
    to `out`.

    Returns
    -------
    dict    `scenes`: for each what is left out, per build the device bytes of path state and
            tables, set-up and compile seconds, bytes of preprocessed source; the ratio of render
            times (everything-on over specialised), and how the two pictures compare

    Raises
    ------
    SceneError, GroomError, DeviceError and what else a render raises
    """
    opened = device if isinstance(device, Device) else open_device(device)
    rows = []
    for path in scenes:
        scene = with_overrides(load_scene(path, overrides=overrides), size=size)
        log.info("%s", scene.name)
        # Sources of the bytes and seconds below; compile times count from an empty cache only
        # where no build of the same text was there before.
        pair = {name: Renderer(scene, opened, specialised=name == "specialised") for name in BUILDS}
        for renderer in pair.values():
            renderer.advance(1)
        turns = in_turns({name: partial(r.advance, spp) for name, r in pair.items()}, rounds)
        rows.append(_row(scene.name, pair, {name: took.wall for name, took in turns.items()}))
    results = {
        **circumstances(opened),
        "size": size,
        "spp": spp,
        "rounds": rounds,
        "scenes": rows,
    }
    write_json(results, Path(out) / "results.json")
    return results


def _row(
    name: str, pair: dict[str, Renderer], seconds: dict[str, NDArray[np.float64]]
) -> dict[str, Any]:
    lean, full = (seconds[build] for build in BUILDS)
    images = [pair[build].image() for build in BUILDS]
    return {
        "scene": name,
        "left_out": images[0].stats["features"]["left_out"],
        "builds": {build: _build_facts(pair[build], seconds[build]) for build in BUILDS},
        "time_ratio": float(np.median(full / lean)),
        "time_ratio_range": [float(np.min(full / lean)), float(np.max(full / lean))],
        "bytes_ratio": _state_and_table_bytes(pair["specialised"])
        / _state_and_table_bytes(pair["everything-on"]),
        "pictures": compare_pictures(*images),
    }


def _build_facts(renderer: Renderer, seconds: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "render_seconds": float(np.median(seconds)),
        "state_and_table_bytes": _state_and_table_bytes(renderer),
        "device_bytes": renderer.memory.total_bytes,
        "table_seconds": renderer.seconds["tables"],
        "compile_seconds": renderer.seconds["compile"],
        "source_bytes": source_bytes(renderer),
    }


def _state_and_table_bytes(renderer: Renderer) -> int:
    return sum(renderer.memory.held(name) for name in ("path state", "material", "film", "light"))


def preprocessed(source: str) -> str:
    """A kernel's text as the compiler sees it: no directives, comments or blank lines."""
    import pcpp

    preprocessor = pcpp.Preprocessor()
    preprocessor.define("__OPENCL_VERSION__ 120")
    preprocessor.parse(source)
    text = io.StringIO()
    preprocessor.write(text)
    lines = text.getvalue().splitlines()
    return "\n".join(line for line in lines if line.strip() and not line.startswith("#line"))


def source_bytes(renderer: Renderer) -> int:
    """Bytes of the preprocessed texts of all stages."""
    texts = renderer.wavefront.texts()
    return sum(len(preprocessed(text)) for text in texts)


def compare_pictures(lean: Image, full: Image) -> dict[str, Any]:
    """Whether two pictures of the same expectation agree: equal bits, or the z of their means.

    Returns
    -------
    dict    equal : bool; largest : float, largest difference of a channel; z : float, difference
            of the mean radiance in standard errors (variances taken as those of independent
            pictures, which overstates the error where paths are shared)
    """
    difference = lean.rgb.astype(np.float64) - full.rgb.astype(np.float64)
    assert lean.variance is not None
    assert full.variance is not None
    variance = lean.variance.astype(np.float64).sum() + full.variance.astype(np.float64).sum()
    # Channels of one pixel are correlated: a factor of three bounds the variance of their sum.
    error = np.sqrt(3.0 * variance) / difference.size
    return {
        "equal": bool(np.array_equal(lean.rgb, full.rgb)),
        "largest": float(np.max(np.abs(difference))),
        "z": float(abs(difference.mean()) / error) if error > 0.0 else 0.0,
    }
