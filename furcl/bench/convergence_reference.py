"""The reference image of a scene: rendered once, kept in the user's cache by its content."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.convergence_variants import settings_of
from furcl.errors import ImageError
from furcl.files import write_cache
from furcl.image.image import Image
from furcl.paths import cache_folder
from furcl.rendering.renderer import Renderer
from furcl.scene.digest import digest

log = logging.getLogger(__name__)

PILOT_SPP = 8
N_CHUNKS = 8
#: Key of the statistics of a part: the hash of the rest of it.
CONTENT = "content"

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


def kernel_digest(renderer: Renderer) -> str:
    """A hash of the texts of all stages as a renderer has compiled them."""
    return digest(*renderer.wavefront.texts())


def choose_variant(
    renderers: Mapping[str, Renderer], seed_of: Callable[..., int], render_once: RenderOnce
) -> tuple[str | None, dict[str, float]]:
    """The variant with the lowest variance for the same rays, by two pilots of 8 samples a pixel.

    The variance is that between the two, since within one samples may depend on each other. If some
    variants sample the light, only those take part: what is found by chance a pilot may miss
    altogether, such as a small sun, and then its variance looks lowest.
    Returns its name, None if there are none, and the figure of each: variance times rays a path.
    """
    figures = {}
    sampled = {name: r for name, r in renderers.items() if r.features.light_sampling}
    for name, renderer in (sampled or renderers).items():
        a, b = (render_once(renderer, seed_of(name, "pilot", k), PILOT_SPP)[0] for k in range(2))
        difference = a.rgb.astype(np.float64) - b.rgb
        rays = a.stats["rays"] / a.stats["paths"]
        figures[name] = float(0.5 * (difference**2).mean() * PILOT_SPP * rays)
    return min(figures, key=figures.__getitem__, default=None), figures


def rendered_spp(spp: int) -> int:
    """Samples a pixel of a reference that is to have `spp`: all parts have equally many."""
    return -(-spp // N_CHUNKS) * N_CHUNKS


def render_reference(
    renderer: Renderer,
    content: str,
    spp: int,
    seed_of: Callable[..., int],
    render_once: RenderOnce,
) -> Reference:
    """Load or render the reference, in 8 independent parts of which each is kept when done.

    Its variance is that between the parts: within one, samples may depend on each other.

    Parameters
    ----------
    content : str       `scene_digest` of the scene
    spp : int           samples a pixel of all parts together, rounded up to a multiple of 8
    """
    part_spp = rendered_spp(spp) // N_CHUNKS
    folder = _folder(renderer, content, part_spp, seed_of)

    def render_part(k: int) -> Image:
        image, seconds, _ = render_once(renderer, seed_of("reference", k), part_spp)
        image.stats["wall_seconds"] = seconds
        return image

    shape = (renderer.film.height, renderer.film.width)
    parts = [
        kept_part(folder / f"part{k}.exr", shape, partial(render_part, k)) for k in range(N_CHUNKS)
    ]
    pictures = [part.rgb.astype(np.float64) for part in parts]
    rgb = np.mean(pictures, axis=0)
    variance = np.var(pictures, axis=0, ddof=1) / N_CHUNKS
    render = renderer.scene.render
    facts = {
        "sampling": render.sampling,
        "light_sampling": render.light_sampling,
        "sequence": render.sequence,
        "spp": part_spp * N_CHUNKS,
        "parts": N_CHUNKS,
        "seconds": sum(part.stats["wall_seconds"] for part in parts),
        "device": sorted({str(part.stats["device"]) for part in parts}),
        "mean": float(rgb.mean()),
        "mean_error": float(np.sqrt(3.0 * variance.sum()) / variance.size),
        "mse": float(variance.mean()),
        "rmse": float(np.sqrt(variance.mean())),
        "key": folder.name,
    }
    return Reference(Image(rgb.astype(np.float32), variance.astype(np.float32)), facts)


def kept_part(path: Path, shape: tuple[int, int], render_part: Callable[[], Image]) -> Image:
    """A part from the cache; rendered, and kept where that is possible, if it is not there as it
    was written.

    Parameters
    ----------
    shape : (height, width)     of its picture [pixels]
    """
    if path.is_file():
        try:
            kept = Image.load(path)
        except ImageError as error:
            log.warning("%s; rendering this part again", error)
        else:
            if kept.stats.get(CONTENT) == _content(kept) and kept.rgb.shape[:2] == shape:
                return kept
            log.warning("%s: is not as it was written; rendering this part again", path)
    image = render_part()
    image.stats.update(json.loads(json.dumps(image.stats, default=str)))
    image.stats[CONTENT] = _content(image)
    write_cache(path, image.save)
    return image


def _content(part: Image) -> str:
    """A hash of the pixels and statistics of a part."""
    stats = {key: value for key, value in part.stats.items() if key != CONTENT}
    return digest(np.ascontiguousarray(part.rgb).tobytes(), stats)


def reference_samples_left(
    renderer: Renderer, content: str, spp: int, seed_of: Callable[..., int]
) -> int:
    """Samples a pixel that `render_reference` has still to render."""
    part_spp = rendered_spp(spp) // N_CHUNKS
    folder = _folder(renderer, content, part_spp, seed_of)
    return part_spp * sum(not (folder / f"part{k}.exr").exists() for k in range(N_CHUNKS))


def _folder(renderer: Renderer, content: str, part_spp: int, seed_of: Callable[..., int]) -> Path:
    """Where the parts of a reference are kept."""
    settings = settings_of(renderer.scene)
    key = digest(content, settings, kernel_digest(renderer), part_spp, seed_of("reference", 0))
    return cache_folder() / "references" / key
