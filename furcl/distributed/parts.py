"""How a render is cut into parts, and how they become its picture again.

Where all pixels take the same number of samples a part is a range of samples. Where they do not,
or a target decides, a part is a render of its own with a seed of its own: how many samples a pixel
takes then depends on its neighbours' samples, and no range of them is known before.

Parts depend on the scene and on `part_spp` alone, and the order in which they are merged depends
on their numbers alone: the picture is the same to the bit however many devices of a kind shared
the work, and in which order they were ready.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from furcl.errors import SceneError
from furcl.image.image import Image
from furcl.image.merge import OF_PART, picture
from furcl.image.moments import MergeTree, Moments
from furcl.scene.tables import Scene
from furcl.values import is_whole, shown

if TYPE_CHECKING:
    from furcl.rendering.renderer import Progress, Renderer

#: Samples a pixel of a part, at least: what is learned in the first of them pays in the others.
LEAST_SPP = 16
#: Parts of a render, at most: each brings a picture to the host.
MOST_PARTS = 256
# Odd, so that the seeds of 2^32 parts differ.
_SEED_STEP = 0x9E3779B9


@dataclass(frozen=True)
class Part:
    """Samples of a picture that one device takes.

    Attributes
    ----------
    number : int        from 0 on
    seed : int
    first : int         sample of every pixel that it begins with
    spp : int           samples a pixel, on average
    """

    number: int
    seed: int
    first: int
    spp: int


def parts_of(scene: Scene, part_spp: int | None = None) -> list[Part]:
    """The parts of a scene's samples.

    Parameters
    ----------
    part_spp : int or None      samples a pixel in each but the last; None: so many that there are
                                at most MOST_PARTS, at least LEAST_SPP

    Raises
    ------
    SceneError      `part_spp` is no whole number above 0
    """
    spp, seed = scene.render.spp, scene.render.seed
    if part_spp is None:
        part_spp = max(LEAST_SPP, -(-spp // MOST_PARTS))
    if not (is_whole(part_spp) and part_spp >= 1):
        raise SceneError(f"part_spp = {shown(part_spp)}: expected a whole number from 1 on")
    ranges = scene.render.allocation == "even"
    return [
        Part(
            number,
            seed if ranges else (seed + number * _SEED_STEP) % (1 << 32),
            first if ranges else 0,
            min(part_spp, spp - first),
        )
        for number, first in enumerate(range(0, spp, part_spp))
    ]


def render_part(renderer: Renderer, part: Part, progress: Progress | None = None) -> Image:
    """The picture of a part, or of those of its samples that there were when it was stopped."""
    renderer.restart(part.seed, part.first)
    complete = renderer.advance(part.spp, progress)
    image = renderer.image()
    image.stats["complete"] = complete
    return image


class Merging:
    """The picture of the parts that are there."""

    def __init__(self) -> None:
        self._tree = MergeTree()
        self._of_parts: dict[int, dict[str, Any]] = {}
        self._like: Image | None = None

    def add(self, part: Part, image: Image) -> None:
        """Add a part.

        Raises
        ------
        ImageError      a layer that cannot be merged
        """
        self._tree.add(part.number, Moments.of(image))
        self._of_parts[part.number] = image.stats
        if self._like is None:
            self._like = image

    def image(self) -> Image | None:
        """The picture of the parts so far; None if there are none."""
        total = self._tree.total()
        if total is None or self._like is None:
            return None
        stats = [self._of_parts[number] for number in sorted(self._of_parts)]
        parts = [{key: one[key] for key in OF_PART if key in one} for one in stats]
        image = picture(total, self._like, stats, parts)
        image.stats["seed"] = parts[0]["seed"]
        image.stats["device"] = ", ".join(dict.fromkeys(str(one["device"]) for one in stats))
        return image
