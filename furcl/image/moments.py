"""Pictures of one scene that become one: sums that can be merged, and their order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.image.image import Image

#: Layers that are means over all samples of a pixel: names of channels, or what is before the dot.
OF_SAMPLES = ("A", "albedo", "direct", "indirect")
#: Layers that are means over the samples that meet something.
OF_HITS = ("Z", "P", "N")


@dataclass(frozen=True, eq=False)
class Moments:
    """Number, mean and sum of squared deviations of the samples of every pixel, in float64.

    Two of them are merged by the update of Chan et al. (1979), whose relative error is
    a few roundings of float64; the means of a picture are float32, so a merged mean is right to
    2^-24 of the largest mean of its parts (tests/test_merge.py). Merging does not depend on the
    order of the two to more than a rounding; `MergeTree` fixes the order, and with it all bits.

    Attributes
    ----------
    n : (H, W) int64                samples
    mean : (H, W, 3)                of their radiance
    squares : (H, W, 3) or None     sum of squared deviations from it; None if unknown
    layers : dict                   channel -> (H, W), its mean
    """

    n: NDArray[np.int64]
    mean: NDArray[np.float64]
    squares: NDArray[np.float64] | None
    layers: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    @staticmethod
    def of(image: Image) -> Moments:
        """Those of a picture.

        Raises
        ------
        ImageError      a picture without numbers of samples, or with a layer that is no mean
        """
        n = _numbers(image)
        mean, squares = image.rgb.astype(np.float64), None
        if image.variance is not None:
            # One sample has no deviation, and its variance is unknown.
            known = np.nan_to_num(image.variance.astype(np.float64), posinf=np.inf)
            squares = known * (n * np.maximum(n - 1, 0))[..., None]
        layers = {k: v.astype(np.float64) for k, v in image.layers.items() if k != "samples"}
        for name in layers:
            _kind(name, layers)
        return Moments(n, mean, squares, layers)

    def __add__(self, other: Moments) -> Moments:
        """Those of all samples together."""
        n = self.n + other.n
        share = (other.n / np.maximum(n, 1))[..., None]
        difference = other.mean - self.mean
        squares = None
        if self.squares is not None and other.squares is not None:
            between = difference**2 * (self.n[..., None] * share)
            squares = self.squares + other.squares + between
        layers = {}
        for name, mine in self.layers.items():
            weights = [m.n.astype(np.float64) for m in (self, other)]
            if _kind(name, self.layers) is OF_HITS:
                weights = [w * m.layers["A"] for w, m in zip(weights, (self, other), strict=True)]
            total = sum(weights)
            part = np.divide(weights[1], total, out=np.zeros_like(mine), where=total > 0.0)
            theirs = other.layers[name]
            # Where one of both has no sample of it, its value says nothing, and may be huge.
            mixed = np.where(part == 1.0, theirs, mine + (theirs - mine) * part)
            layers[name] = mixed
        return Moments(n, self.mean + difference * share, squares, layers)

    def arrays(self) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Mean and variance of the mean, as `Image` has them."""
        n = self.n[..., None]
        if self.squares is None:
            return self.mean.astype(np.float32), None
        with np.errstate(invalid="ignore", divide="ignore"):
            variance = np.where(n > 1, self.squares / (n * (n - 1.0)), np.nan)
        return self.mean.astype(np.float32), variance.astype(np.float32)


class MergeTree:
    """Merges numbered parts as they come: neighbours first, as in a binary tree over all numbers.

    What comes out depends on which parts there are and not on their order, to the bit. At most one
    part a level of the tree waits for its neighbour where they come in order.
    """

    def __init__(self) -> None:
        self._waiting: dict[tuple[int, int], Moments] = {}

    def add(self, number: int, part: Moments) -> None:
        """Add part `number`, from 0 on, each once."""
        level = 0
        while (neighbour := self._waiting.pop((level, number ^ 1), None)) is not None:
            part = part + neighbour if number % 2 == 0 else neighbour + part
            level, number = level + 1, number >> 1
        self._waiting[level, number] = part

    def total(self) -> Moments | None:
        """All parts so far; None if there are none."""
        order = sorted(self._waiting, key=lambda at: at[1] << at[0])
        parts = [self._waiting[at] for at in order]
        total = parts[0] if parts else None
        for part in parts[1:]:
            total = total + part if total else part
        return total


def _numbers(image: Image) -> NDArray[np.int64]:
    """Samples of each pixel."""
    if image.samples is not None:
        return image.samples.astype(np.int64)
    spp = image.stats.get("spp")
    if not isinstance(spp, int) or isinstance(spp, bool) or spp < 1:
        raise ImageError(
            "the picture does not say how many samples its pixels have, by a channel 'samples' or "
            "'spp' in its statistics; merge pictures that furcl rendered"
        )
    return np.full(image.rgb.shape[:2], spp, np.int64)


def _kind(name: str, layers: Mapping[str, object]) -> tuple[str, ...]:
    """What a layer is a mean over: OF_SAMPLES or OF_HITS."""
    first = name.split(".")[0]
    if first in OF_SAMPLES or first.startswith("lobe_"):
        return OF_SAMPLES
    if first in OF_HITS and "A" in layers:
        return OF_HITS
    why = "needs the layer alpha beside it" if first in OF_HITS else "is no mean over samples"
    raise ImageError(
        f"the layer {name} cannot be merged: it {why}; render in one piece, or change film.layers"
    )
