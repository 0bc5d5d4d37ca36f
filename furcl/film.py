"""The film: running mean and variance of every pixel, on the device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from furcl.buffers import Memory, fill
from furcl.features import Features


@dataclass(frozen=True, eq=False)
class Film:
    """Device planes of a picture; their meaning is in kernels/film.cl.

    Attributes
    ----------
    width, height : int     [pixels]
    planes : Buffer         float32 planes of width * height
    n_samples : Buffer      uint32 samples added to each pixel
    nonfinite : Buffer      one uint32: samples that were NaN or infinite
    """

    width: int
    height: int
    features: Features
    planes: cl.Buffer
    n_samples: cl.Buffer
    nonfinite: cl.Buffer

    @staticmethod
    def allocate(memory: Memory, width: int, height: int, features: Features) -> Film:
        """An empty film.

        Raises
        ------
        ResourceError   if the device allows no buffer of that size
        """
        n_pixels = width * height
        n_planes = features.channels * (4 if features.variance else 2)
        return Film(
            width,
            height,
            features,
            memory.allocate("film", 4 * n_planes * n_pixels, zero=True),
            memory.allocate("film samples", 4 * n_pixels, zero=True),
            memory.allocate("nonfinite", 16, zero=True),
        )

    def clear(self, queue: cl.CommandQueue) -> None:
        """Take all samples back out."""
        for buffer in (self.planes, self.n_samples, self.nonfinite):
            fill(queue, buffer, 0, buffer.size)

    def read(self, memory: Memory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean radiance, variance of that mean and samples of every pixel.

        Returns
        -------
        mean, variance : (height, width, 3) float32     variance is that of the mean: sample
            variance / samples; NaN where a pixel has fewer than two samples or none is kept
        samples : (height, width) uint32
        """
        channels, per_channel = self.features.channels, 4 if self.features.variance else 2
        shape = (channels, per_channel, self.height, self.width)
        planes = memory.read(self.planes, shape).astype(np.float64)
        samples = memory.read(self.n_samples, (self.height, self.width), np.uint32)
        n = samples.astype(np.float64)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = (planes[:, 0] - planes[:, 1]) / n
            variance = np.full_like(mean, np.nan)
            if self.features.variance:
                squares = planes[:, 2] - planes[:, 3]
                variance = np.where(n > 1, squares / (n * (n - 1)), np.nan)
        return _rgb(mean), _rgb(variance), samples

    def read_nonfinite(self, memory: Memory) -> int:
        """Samples so far that were NaN or infinite."""
        return int(memory.read(self.nonfinite, 1, np.uint32)[0])


def _rgb(planes: np.ndarray) -> np.ndarray:
    """(channels, H, W) to (H, W, 3) float32; one channel is grey."""
    spread = np.broadcast_to(planes, (3, *planes.shape[1:]))
    return np.ascontiguousarray(np.moveaxis(spread, 0, -1)).astype(np.float32)
