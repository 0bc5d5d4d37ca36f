"""The reference image of a scene: rendered once, kept in the user's cache by its content."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from furcl.errors import ImageError
from furcl.fibre import samplers
from furcl.files import write_cache
from furcl.image.image import Image
from furcl.paths import cache_folder
from furcl.rendering.renderer import Renderer
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)

PILOT_SPP = 8
N_CHUNKS = 8

#: Renders `spp` samples of a seed with a renderer; returns the image and its wall and CPU seconds.
RenderOnce = Callable[[Renderer, int, int], tuple[Image, float, float]]


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference image.

    Attributes
    ----------
    image : Image           mean and variance of that mean
    facts : dict            what results.json says about it
    """

    image: Image
    facts: dict[str, Any]

    @property
    def variance(self) -> np.ndarray:
        """(H, W, 3) float64 variance of every value."""
        assert self.image.variance is not None
        return self.image.variance.astype(np.float64)


def digest(*parts: object) -> str:
    """A short hash of texts, bytes and JSON values."""
    state = hashlib.sha256()
    for part in parts:
        raw = part if isinstance(part, bytes) else json.dumps(part, sort_keys=True).encode()
        state.update(len(raw).to_bytes(8, "little") + raw)
    return state.hexdigest()[:20]


def kernel_digest(renderer: Renderer) -> str:
    """A hash of the texts of all stages as a renderer has compiled them."""
    return digest(*renderer.wavefront.texts())


def scene_digest(scene: Scene) -> str:
    """A hash of all that the picture of a scene follows from, but samples, seed and sampler."""
    document = msgspec.to_builtins(scene)
    for name in ("spp", "seed", "sampling"):
        del document["render"][name]
    del document["name"], document["film"]["exposure_stops"]
    curves = scene.build_curves()
    arrays = (curves.points, curves.radii, curves.offsets)
    parts: list[object] = [np.ascontiguousarray(array).tobytes() for array in arrays]
    if "file" in document["environment"]:
        parts.append(Path(document["environment"].pop("file")).read_bytes())
    if document["curves"]["generator"] == "file":
        del document["curves"]["file"]
    return digest(document, *parts)


def choose_sampler(
    renderers: Mapping[str, Renderer], seed_of: Callable[..., int], render_once: RenderOnce
) -> tuple[str, dict[str, float]]:
    """The sampler with the lowest variance for the same rays, by a pilot of 8 samples a pixel.

    Only samplers that come with furcl may make the reference: one that is being tried out may be
    wrong. Returns its name and the figure of each, variance times rays a path.
    """
    figures = {}
    for name, renderer in renderers.items():
        if name not in samplers.BUILT_IN:
            continue
        image, _, _ = render_once(renderer, seed_of(name, "pilot"), PILOT_SPP)
        assert image.variance is not None
        rays = image.stats["rays"] / image.stats["paths"]
        figures[name] = float(image.variance.astype(np.float64).mean() * PILOT_SPP * rays)
    return min(figures, key=figures.__getitem__), figures


def render_reference(
    renderer: Renderer,
    content: str,
    spp: int,
    seed_of: Callable[..., int],
    render_once: RenderOnce,
) -> Reference:
    """Load or render the reference, in 8 independent parts of which each is kept when done.

    Parameters
    ----------
    content : str       `scene_digest` of the scene
    spp : int           samples a pixel of all parts together, rounded up to a multiple of 8
    """
    part_spp = -(-spp // N_CHUNKS)
    sampling = renderer.scene.render.sampling
    first_seed = seed_of("reference", 0)
    key = digest(content, kernel_digest(renderer), part_spp, first_seed)
    folder = cache_folder() / "references" / key

    def render_part(k: int) -> Image:
        image, seconds, _ = render_once(renderer, seed_of("reference", k), part_spp)
        image.stats["wall_seconds"] = seconds
        return image

    parts = [_kept(folder / f"part{k}.exr", partial(render_part, k)) for k in range(N_CHUNKS)]
    rgb = np.mean([part.rgb.astype(np.float64) for part in parts], axis=0)
    variances = [np.asarray(part.variance, np.float64) for part in parts]
    variance = np.sum(variances, axis=0) / N_CHUNKS**2
    facts = {
        "sampling": sampling,
        "light_sampling": renderer.scene.render.light_sampling,
        "spp": part_spp * N_CHUNKS,
        "parts": N_CHUNKS,
        "seconds": sum(part.stats["wall_seconds"] for part in parts),
        "device": sorted({str(part.stats["device"]) for part in parts}),
        "mean": float(rgb.mean()),
        "mean_error": float(np.sqrt(3.0 * variance.sum()) / variance.size),
        "mse": float(variance.mean()),
        "rmse": float(np.sqrt(variance.mean())),
        "key": key,
    }
    return Reference(Image(rgb.astype(np.float32), variance.astype(np.float32)), facts)


def _kept(path: Path, render_part: Callable[[], Image]) -> Image:
    """A part from the cache; rendered, and kept where that is possible, if none can be read."""
    if path.is_file():
        try:
            return Image.load(path)
        except ImageError as error:
            log.warning("%s; rendering this part again", error)
    image = render_part()
    write_cache(path, image.save)
    return image


def reference_samples_left(
    renderer: Renderer, content: str, spp: int, seed_of: Callable[..., int]
) -> int:
    """Samples a pixel that `render_reference` has still to render."""
    part_spp = -(-spp // N_CHUNKS)
    key = digest(content, kernel_digest(renderer), part_spp, seed_of("reference", 0))
    folder = cache_folder() / "references" / key
    return part_spp * sum(not (folder / f"part{k}.exr").exists() for k in range(N_CHUNKS))
