"""Steps of a render whose pixels take different numbers of samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.device.memory import Memory, fill
from furcl.rendering import allocation

#: Samples a pixel that a step ends at, over those that it begins with: a render that is stopped
#: within a step has some pixels with the numbers of its end and some with those of its beginning.
STEP_GROWTH = 1.5

#: A step's paths are numbered by 32 bits.
MOST_PATHS = (1 << 32) - 1


@dataclass(frozen=True, eq=False)
class PlanBuffers:
    """A plan on the device, and what plans are made of; kernels/stages/film.cl has the meanings.

    Attributes
    ----------
    plan : Buffer       uint32 (2 pixels + 1): the step, see kernels/include/core/paths.clh
    pilots : Buffer     float32 (levels, pixels, 3): variance, relative variance, rays of a sample
    n_rays : Buffer     uint32 rays of each pixel
    n_levels : uint32
    """

    plan: cl.Buffer
    pilots: cl.Buffer
    n_rays: cl.Buffer
    n_levels: np.uint32

    @staticmethod
    def allocate(memory: Memory, n_pixels: int, spp: int) -> PlanBuffers:
        """Buffers of an empty plan, with the levels that `spp` samples a pixel can use.

        Raises
        ------
        ResourceError   if the device allows no buffer of that size
        """
        n_levels = allocation.n_levels(spp, n_pixels)
        return PlanBuffers(
            memory.allocate("plan", 4 * (2 * n_pixels + 1), zero=True),
            memory.allocate("pilots", 12 * n_levels * n_pixels, zero=True),
            memory.allocate("pixels' rays", 4 * n_pixels, zero=True),
            np.uint32(n_levels),
        )

    def clear(self, queue: cl.CommandQueue) -> None:
        """Forget all samples."""
        for buffer in (self.plan, self.pilots, self.n_rays):
            fill(queue, buffer, 0, buffer.size)


class SamplePlan:
    """Decides step by step how many samples each pixel takes, and cuts steps into waves.

    Parameters
    ----------
    width, height : int         [pixels]

    Attributes
    ----------
    counts : (H, W) int64       samples of each pixel when the step under way is done
    steps : int                 plans so far
    """

    def __init__(self, memory: Memory, buffers: PlanBuffers, width: int, height: int) -> None:
        self._queue = memory.device.queue
        self._buffers = buffers
        self._order = tile_order(width, height)
        self._colour = allocation.checkerboard(height, width)
        self.counts = np.zeros((height, width), np.int64)
        self.restart()

    def restart(self) -> None:
        """Forget all samples."""
        self.counts[:] = 0
        self.steps = 0
        self._goal = self._level_reached = 0
        self._starts = np.zeros(self.counts.size + 1, np.int64)
        self._first = np.zeros(self.counts.size, np.int64)
        self._done = 0

    def cut(self, wave: np.ndarray, most: int, spp: int) -> int:
        """Fill in which paths a wave holds: the next of the step, or of a new one.

        Parameters
        ----------
        wave : struct Wave
        most : int          paths that it may hold
        spp : int           samples a pixel, on average, that the render ends with

        Returns
        -------
        int     pixels in tile order from the wave's first to its last
        """
        while self._done == self._starts[-1]:
            self._begin_step(spp)
        first, last = (
            int(np.searchsorted(self._starts, path, side="right")) - 1
            for path in (self._done, min(self._done + most, int(self._starts[-1])) - 1)
        )
        wave["n_paths"] = min(most, int(self._starts[-1]) - self._done)
        wave["first_pixel"] = first
        wave["first_sample"] = self._first[first] + self._done - self._starts[first]
        self._done += int(wave["n_paths"])
        return last - first + 1

    def _begin_step(self, spp: int) -> None:
        """Plan the next step and send it to the device."""
        taken = self.counts
        self.counts = self._plan(spp)
        self.steps += 1
        new = (self.counts - taken).ravel()[self._order]
        self._starts = np.concatenate([[0], np.cumsum(new)])
        self._first = taken.ravel()[self._order]
        self._done = 0
        words = np.concatenate([self._starts, self._first]).astype(np.uint32)
        cl.enqueue_copy(self._queue, self._buffers.plan, words)

    def _plan(self, spp: int) -> NDArray[np.int64]:
        """The numbers of samples that the next step ends with.

        Which step follows is a matter of sample counts alone, never of what the samples were.
        """
        before, self._goal = self._goal, self._next_goal(spp)
        if before < allocation.pilot_samples(0):
            return np.full_like(self.counts, self._goal)
        level = self._level(before)
        if level > self._level_reached:
            self._level_reached, self._goal = level, before
            return np.maximum(self.counts, allocation.pilot_samples(level))
        return self._shares(level)

    def _next_goal(self, spp: int) -> int:
        """Samples a pixel, on average, that the next step ends with."""
        first = allocation.pilot_samples(0)
        if self._goal < first:
            return min(first, spp)
        most = self._goal + MOST_PATHS // self.counts.size
        return min(math.ceil(STEP_GROWTH * self._goal), most, max(spp, self._goal + 1))

    def _level(self, before: int) -> int:
        """Level of the pilots that the step rests on.

        A new level wants all pixels to have its samples first, at worst as many more for each as
        the levels differ by; together that must not be more than the step has.
        """
        pilot = allocation.pilot_samples
        level = self._level_reached
        while (
            level + 1 < self._buffers.n_levels
            and pilot(level + 1) <= allocation.PILOT_SHARE * self._goal
            and before + pilot(level + 1) - pilot(self._level_reached) <= self._goal
        ):
            level += 1
        return level

    def _shares(self, level: int) -> NDArray[np.int64]:
        """Numbers in proportion to what the pilots of a level say, each colour by the other's."""
        shape = (*self.counts.shape, 3)
        pilots = np.empty(shape, np.float32)
        cl.enqueue_copy(self._queue, pilots, self._buffers.pilots, src_offset=level * pilots.nbytes)
        weights = allocation.weights(pilots)
        counts = self.counts.copy()
        for mine in (self._colour, ~self._colour):
            total = self._goal * int(mine.sum())
            least = allocation.EVEN_SHARE * self._goal
            counts[mine] = allocation.allot(weights[mine], counts[mine], total, least)
        return counts


def tile_order(width: int, height: int) -> NDArray[np.int64]:
    """Indices, row by row, of the pixels in the order in which paths take them: strips of eight
    rows, column by column, as in kernels/include/core/paths.clh."""
    index = np.arange(width * height).reshape(height, width)
    return np.concatenate([index[y : y + 8].T.ravel() for y in range(0, height, 8)])
