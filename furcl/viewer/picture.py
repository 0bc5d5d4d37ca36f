"""Pictures on their way to a page, and what is kept of them."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from furcl.image.error import estimated_errors
from furcl.image.image import Image
from furcl.image.size import Window

#: The largest float16; brighter pixels are shown as that.
BRIGHTEST = 65504.0


@dataclass(frozen=True, eq=False)
class Moments:
    """A picture so far: mean (H, W, 3), variance of the mean, NaN where it is not known, and
    samples (H, W) of each pixel."""

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    samples: NDArray[np.uint32]

    def with_more(self, more: Moments) -> Moments:
        """All samples of two pictures, of other samples each, that have the same pixels."""
        n, m = (part.samples[..., None].astype(np.float64) for part in (self, more))
        total = np.maximum(n + m, 1.0)
        mine, theirs = n / total, m / total
        mean = mine * _known(self.mean, n) + theirs * _known(more.mean, m)
        squares = mine**2 * _of(self.variance, n) + theirs**2 * _of(more.variance, m)
        return Moments(
            mean.astype(np.float32), squares.astype(np.float32), self.samples + more.samples
        )

    @property
    def whole_samples(self) -> int:
        """Samples that every pixel has."""
        return int(self.samples.min())

    @property
    def noise(self) -> float | None:
        """Root of the estimated relMSE; None while pixels have fewer than two samples."""
        if self.whole_samples < 2:
            return None
        errors = estimated_errors(self.mean, self.variance)
        return None if errors is None else errors["relmse"]["estimate"] ** 0.5

    def image(self, stats: dict[str, Any], exposure_stops: float, window: Window) -> Image:
        """As a picture to be saved; pixels without samples are 0."""
        empty = self.samples == 0
        mean, variance = self.mean.copy(), self.variance.copy()
        mean[empty] = variance[empty] = 0.0
        return Image(
            mean,
            variance,
            stats,
            exposure_stops,
            self.samples,
            None if window.whole else window,
        )


def _known(mean: NDArray[np.float32], n: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(n > 0.0, mean, 0.0)


def _of(variance: NDArray[np.float32], n: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(n > 0.0, variance.astype(np.float64), 0.0)


def encoded(moments: Moments, facts: dict[str, Any]) -> bytes:
    """A message of a picture: the length of a JSON text as uint32, the text, padding to a multiple
    of 4, and float16 (H, W, 3), NaN where there are no samples; little endian.

    Parameters
    ----------
    facts : dict    JSON values; `columns` and `rows` are added
    """
    height, width = moments.samples.shape
    text = msgspec.json.encode({**facts, "columns": width, "rows": height})
    text += b" " * (-len(text) % 4)
    shown = np.minimum(moments.mean, np.float32(BRIGHTEST)).astype("<f2")
    shown[moments.samples == 0] = np.nan
    return struct.pack("<I", len(text)) + text + shown.tobytes()


def decoded(message: bytes) -> tuple[dict[str, Any], NDArray[np.float16]]:
    """Facts and pixels of a message of `encoded`."""
    (length,) = struct.unpack_from("<I", message)
    facts = msgspec.json.decode(message[4 : 4 + length])
    pixels = np.frombuffer(message, "<f2", offset=4 + length)
    return facts, pixels.reshape(facts["rows"], facts["columns"], 3)
