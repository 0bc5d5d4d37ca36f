"""The film: running mean and variance of every pixel, on the device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from furcl.device.features import Features
from furcl.device.memory import Memory, fill
from furcl.image.size import strips
from furcl.rendering.layers import LayerBuffers
from furcl.rendering.plan import PlanBuffers


@dataclass(frozen=True, eq=False)
class Film:
    """Sums of a picture on the device; their meaning is in kernels/stages/film.cl.

    Attributes
    ----------
    width, height : int     [pixels]
    sums : Buffer           float32, (height, width, 4 or, without variance, 2, channels)
    n_samples : Buffer      uint32 samples added to each pixel
    nonfinite : Buffer      one uint32: samples that were NaN or infinite
    plan : PlanBuffers or None      where a plan says how many samples each pixel takes
    layers : LayerBuffers or None   where there are layers beside the picture
    """

    width: int
    height: int
    features: Features
    sums: cl.Buffer
    n_samples: cl.Buffer
    nonfinite: cl.Buffer
    plan: PlanBuffers | None = None
    layers: LayerBuffers | None = None

    @staticmethod
    def allocate(memory: Memory, width: int, height: int, features: Features, spp: int = 1) -> Film:
        """An empty film, which may be meant for `spp` samples a pixel.

        Raises
        ------
        ResourceError   if the device allows no buffer of that size
        """
        n_pixels = width * height
        n_sums = features.channels * (4 if features.variance else 2)
        return Film(
            width,
            height,
            features,
            memory.allocate("film", 4 * n_sums * n_pixels, zero=True),
            memory.allocate("film samples", 4 * n_pixels, zero=True),
            memory.allocate("nonfinite", 16, zero=True),
            PlanBuffers.allocate(memory, n_pixels, spp) if features.planned else None,
            LayerBuffers(memory, n_pixels, features) if features.layers else None,
        )

    def clear(self, queue: cl.CommandQueue) -> None:
        """Take all samples back out."""
        for buffer in (self.sums, self.n_samples, self.nonfinite):
            fill(queue, buffer, 0, buffer.size)
        for more in (self.plan, self.layers):
            if more:
                more.clear(queue)

    def read(self, memory: Memory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mean radiance, variance of that mean and samples of every pixel.

        Returns
        -------
        mean, variance : (height, width, 3) float32     variance is that of the mean: sample
            variance / samples; NaN where a pixel has fewer than two samples or none is kept
        samples : (height, width) uint32
        """
        shape = (self.height, self.width)
        mean, variance = (np.empty((*shape, 3), np.float32) for _ in range(2))
        samples = memory.read(self.n_samples, shape, np.uint32)
        for rows in strips(*shape):
            mean[rows], variance[rows] = self._read_rows(memory, rows, samples[rows])
        return mean, variance, samples

    def _read_rows(
        self, memory: Memory, rows: slice, samples: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean and variance of some rows, (rows, width, channels) float64."""
        per_pixel = 4 if self.features.variance else 2
        shape = (rows.stop - rows.start, self.width, per_pixel, self.features.channels)
        offset = 4 * rows.start * self.width * per_pixel * self.features.channels
        sums = np.moveaxis(memory.read(self.sums, shape, offset=offset).astype(np.float64), 2, 0)
        n = samples[..., None].astype(np.float64)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = (sums[0] - sums[1]) / n
            if not self.features.variance:
                return mean, np.full_like(mean, np.nan)
            squares = sums[2] - sums[3]
            return mean, np.where(n > 1, squares / (n * (n - 1)), np.nan)

    def read_nonfinite(self, memory: Memory) -> int:
        """Samples so far that were NaN or infinite."""
        return int(memory.read(self.nonfinite, 1, np.uint32)[0])
