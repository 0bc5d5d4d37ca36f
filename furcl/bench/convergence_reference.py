"""The reference image of a scene: rendered once, kept in the user's cache by its content."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.convergence_renderers import Facts, Render, Rendered, Sweep
from furcl.bench.convergence_variants import Variant
from furcl.errors import ImageError
from furcl.files import write_cache
from furcl.image.image import Image
from furcl.paths import cache_folder
from furcl.scene.digest import digest
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)

PILOT_SPP = 8
N_CHUNKS = 8
#: Key of the statistics of a part: the hash of the rest of it.
CONTENT = "content"


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


def choose_variant(
    facts: Mapping[Variant, Facts], seed_of: Callable[..., int], sweep: Sweep
) -> tuple[Variant | None, dict[str, float]]:
    """The variant with the lowest variance for the same rays, by two pilots of 8 samples a pixel.

    The variance is that between the two, since within one samples may depend on each other. If some
    variants sample the light, only those take part: what is found by chance a pilot may miss
    altogether, such as a small sun, and then its variance looks lowest.
    Returns it, None if there are none, and the figure of each by name: variance times rays a path.
    """
    taking_part = [v for v, f in facts.items() if f.light_sampling] or list(facts)
    pilots = [
        Render(variant, PILOT_SPP, seed_of(variant.name, "pilot", k), k)
        for variant in taking_part
        for k in range(2)
    ]
    images = {
        render: rendered.image
        for render, rendered in sweep.renders([[pilot] for pilot in pilots], count=False)
    }
    figures = {}
    for first, second in zip(pilots[::2], pilots[1::2], strict=True):
        a, b = images[first], images[second]
        difference = a.rgb.astype(np.float64) - b.rgb
        rays = a.stats["rays"] / a.stats["paths"]
        figures[first.variant.name] = float(0.5 * (difference**2).mean() * PILOT_SPP * rays)
    best = min(figures, key=figures.__getitem__, default=None)
    return next((v for v in taking_part if v.name == best), None), figures


def rendered_spp(spp: int) -> int:
    """Samples a pixel of a reference that is to have `spp`: all parts have equally many."""
    return -(-spp // N_CHUNKS) * N_CHUNKS


class Parts:
    """The 8 independent parts of a reference, of which each is kept when it is rendered.

    The variance is that between the parts: within one, samples may depend on each other.

    Parameters
    ----------
    variant : Variant
    scene : Scene           with its settings
    facts : Facts           of the variant
    content : str           `scene_digest` of the scene
    spp : int               samples a pixel of all parts together, rounded up to a multiple of 8
    seed_of : callable      `Plan.seed_of`

    Attributes
    ----------
    missing : list of Render    that are not in the cache as they were written
    """

    def __init__(
        self,
        variant: Variant,
        scene: Scene,
        facts: Facts,
        content: str,
        spp: int,
        seed_of: Callable[..., int],
    ) -> None:
        self._scene, self._spp = scene, rendered_spp(spp) // N_CHUNKS
        settings, first = facts.setup["settings"], seed_of("reference", 0)
        self._key = digest(content, settings, facts.kernels, self._spp, first)
        shape = (scene.film.height, scene.film.width)
        found = {k: kept_part(self._path(k), shape) for k in range(N_CHUNKS)}
        self._parts = {k: part for k, part in found.items() if part is not None}
        self.missing = [
            Render(variant, self._spp, seed_of("reference", k), k)
            for k, part in found.items()
            if part is None
        ]

    def add(self, number: int, rendered: Rendered) -> None:
        """Take a part that was missing, and keep it where that is possible."""
        part = rendered.image
        part.stats["wall_seconds"] = rendered.seconds
        keep_part(self._path(number), part)
        self._parts[number] = part

    def reference(self) -> Reference:
        """The reference of all parts."""
        parts = [self._parts[k] for k in range(N_CHUNKS)]
        pictures = [part.rgb.astype(np.float64) for part in parts]
        rgb = np.mean(pictures, axis=0)
        variance = np.var(pictures, axis=0, ddof=1) / N_CHUNKS
        render = self._scene.render
        facts = {
            "sampling": render.sampling,
            "light_sampling": render.light_sampling,
            "sequence": render.sequence,
            "spp": self._spp * N_CHUNKS,
            "parts": N_CHUNKS,
            "seconds": sum(part.stats["wall_seconds"] for part in parts),
            "device": sorted({str(part.stats["device"]) for part in parts}),
            "mean": float(rgb.mean()),
            "mean_error": float(np.sqrt(3.0 * variance.sum()) / variance.size),
            "mse": float(variance.mean()),
            "rmse": float(np.sqrt(variance.mean())),
            "key": self._key,
        }
        return Reference(Image(rgb.astype(np.float32), variance.astype(np.float32)), facts)

    def _path(self, number: int) -> Path:
        return cache_folder() / "references" / self._key / f"part{number}.exr"


def kept_part(path: Path, shape: tuple[int, int]) -> Image | None:
    """A part from the cache; None where it is not there as it was written.

    Parameters
    ----------
    shape : (height, width)     of its picture [pixels]
    """
    if not path.is_file():
        return None
    try:
        kept = Image.load(path)
    except ImageError as error:
        log.warning("%s; rendering this part again", error)
        return None
    if kept.stats.get(CONTENT) == _content(kept) and kept.rgb.shape[:2] == shape:
        return kept
    log.warning("%s: is not as it was written; rendering this part again", path)
    return None


def keep_part(path: Path, part: Image) -> None:
    """Put a part into the cache, if that is possible, with a hash among its statistics."""
    part.stats.update(json.loads(json.dumps(part.stats, default=str)))
    part.stats[CONTENT] = _content(part)
    write_cache(path, part.save)


def _content(part: Image) -> str:
    """A hash of the pixels and statistics of a part."""
    stats = {key: value for key, value in part.stats.items() if key != CONTENT}
    return digest(np.ascontiguousarray(part.rgb).tobytes(), stats)
