"""Pictures of one scene, of other samples each, as one picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from furcl.errors import ImageError
from furcl.image.denoise import refuse_denoised
from furcl.image.error import estimated_errors
from furcl.image.image import Image
from furcl.image.moments import MergeTree, Moments
from furcl.values import shown

#: Statistics that must be the same in pictures that are merged.
SAME = (
    "scene", "version", "git", "width", "height", "crop", "transparent", "segments", "sampling",
    "sequence", "layers",
)  # fmt: skip
#: Statistics that are added up.
ADDED = ("paths", "rays", "nonfinite")
#: What each part keeps of its own statistics.
OF_PART = ("seed", "first_sample", "spp", "allocation", "device", "driver")


def merged(images: Iterable[Image], names: Sequence[str] | None = None) -> Image:
    """One picture of pictures of the same scene with other samples each, weighted by their number.

    The mean over all samples, its variance and the layers that are means are those of a render
    that took all the samples, to the rounding of float32 (`Moments`). Pictures are merged in the
    order of seed and first sample, so the order in which they are given changes no bit.

    Parameters
    ----------
    images : Images         of `furcl.render`, or loaded from .exr files
    names : texts or None   what errors call them

    Raises
    ------
    ImageError      fewer than two; pictures of different scenes, sizes, windows, versions or
                    settings; of the same samples; layers or pictures that cannot be merged
    """
    found = list(images)
    called = names or [f"picture {i}" for i in range(len(found))]
    if len(found) < 2:
        raise ImageError(f"{len(found)} picture to merge; give two or more")
    for image, name in zip(found, called, strict=True):
        refuse_denoised(image, name, "merge the renders, then denoise the whole")
        _check_together(found[0], called[0], image, name)
    parts = [_parts(image, name) for image, name in zip(found, called, strict=True)]
    _check_apart(parts, called)
    order = sorted(range(len(found)), key=lambda i: _place(parts[i][0]))
    tree = MergeTree()
    for place, i in enumerate(order):
        try:
            tree.add(place, Moments.of(found[i]))
        except ImageError as error:
            raise ImageError(f"{called[i]}: {error}") from None
    total = tree.total()
    assert total is not None
    stats = [found[i].stats for i in order]
    return picture(total, found[order[0]], stats, [part for i in order for part in parts[i]])


def picture(
    total: Moments, like: Image, stats: Sequence[Mapping[str, Any]], parts: list[dict[str, Any]]
) -> Image:
    """A picture of merged moments, with statistics of its parts' statistics.

    Parameters
    ----------
    like : Image        one of the parts: for what is the same in all
    stats : dicts       of all parts
    parts : dicts       what is told of each
    """
    rgb, variance = total.arrays()
    samples = total.n.astype(np.uint32)
    empty = samples == 0
    if variance is not None:
        variance[empty] = 0.0
    layers = {name: values.astype(np.float32) for name, values in total.layers.items()}
    if "samples" in like.layers:
        layers["samples"] = samples.astype(np.float32)
    first = stats[0]
    told = {key: first[key] for key in first if all(s.get(key) == first[key] for s in stats)}
    told |= {key: sum(s[key] for s in stats) for key in ADDED if all(key in s for s in stats)}
    for key in ("seconds", "lobes"):
        if all(isinstance(s.get(key), Mapping) for s in stats):
            told[key] = _added([s[key] for s in stats])
    hits, paths = sum(told.get("lobes", {}).values()), told.get("paths", 0)
    if paths:
        told["hits_per_path"] = hits / paths
        told["path_length"] = sum(s["path_length"] * s["paths"] for s in stats) / paths
    told |= {
        "spp": int(samples.sum(dtype=np.uint64)) // samples.size,
        "samples": {"min": int(samples.min()), "max": int(samples.max())},
        "pixels_without_samples": int(empty.sum()),
        "error": None if variance is None or empty.any() else estimated_errors(rgb, variance),
        "layers": sorted(layers),
        "complete": all(s.get("complete", True) for s in stats),
        "parts": parts,
    }
    return Image(
        rgb, variance, told, like.exposure_stops, samples, like.window, layers,
        transparent=like.transparent,
    )  # fmt: skip


def _check_together(first: Image, first_name: str, image: Image, name: str) -> None:
    """Refuse a picture that shows something else than the first does."""
    if image.rgb.shape != first.rgb.shape or image.window != first.window:
        raise ImageError(
            f"{name}: has {image.width} x {image.height} pixels"
            f"{f' of {image.window}' if image.window else ''}, {first_name} has "
            f"{first.width} x {first.height}{f' of {first.window}' if first.window else ''}; merge "
            f"pictures of one size and window"
        )
    for key in SAME:
        mine, theirs = first.stats.get(key), image.stats.get(key)
        if mine != theirs:
            raise ImageError(
                f"{name}: its {key} is {shown(theirs)}, that of {first_name} is {shown(mine)}; "
                f"merge pictures of one scene, rendered with the same settings by the same furcl"
            )
    if image.layers.keys() != first.layers.keys():
        raise ImageError(
            f"{name}: has the layers {sorted(image.layers)}, {first_name} has "
            f"{sorted(first.layers)}; merge pictures with the same layers"
        )
    if (image.variance is None) != (first.variance is None):
        without = name if image.variance is None else first_name
        raise ImageError(f"{without}: has no variance, and the others do; render all with it")


def _parts(image: Image, name: str) -> list[dict[str, Any]]:
    """What samples a picture holds: those of each part, where it was merged before."""
    parts = image.stats.get("parts", [{k: image.stats[k] for k in OF_PART if k in image.stats}])
    for part in parts:
        if not all(isinstance(part.get(key), int) for key in ("seed", "spp")):
            raise ImageError(
                f"{name}: its statistics do not say which samples it holds; merge pictures that "
                f"furcl rendered"
            )
    return parts


def _place(part: Mapping[str, Any]) -> tuple[int, int]:
    return part["seed"], part.get("first_sample", 0)


def _check_apart(parts: Sequence[Sequence[Mapping[str, Any]]], names: Sequence[str]) -> None:
    """Refuse samples that are there twice: they are no new samples."""
    every = [
        (*_place(part), part, name) for of, name in zip(parts, names, strict=True) for part in of
    ]
    every.sort(key=lambda one: one[:2])
    for (seed, first, part, name), (other, start, _, twin) in pairwise(every):
        # Pixels with different numbers of samples have no range in common: the seed is theirs.
        own = part.get("allocation") == "adaptive"
        if seed == other and (own or start < first + part["spp"]):
            raise ImageError(
                f"{twin}: holds samples that {name} holds too, from sample {start} of seed {seed} "
                f"on; render with another --seed, or with --samples"
            )


def _added(dicts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    total: dict[str, float] = {}
    for one in dicts:
        for key, value in one.items():
            total[key] = total.get(key, 0) + value
    return total
