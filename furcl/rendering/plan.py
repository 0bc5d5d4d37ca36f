"""Steps of a render whose pixels take different numbers of samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.device.memory import Memory, fill
from furcl.rendering import allocation
from furcl.rendering.target import Target

if TYPE_CHECKING:
    from furcl.rendering.film import Film

#: A step's paths are numbered by 32 bits.
MOST_PATHS = (1 << 32) - 1


@dataclass(frozen=True, eq=False)
class PlanBuffers:
    """A plan on the device, and what plans are made of; kernels/stages/film.cl has the meanings.

    Attributes
    ----------
    plan : Buffer       uint32 (2 pixels + 1): the step, see kernels/include/core/paths.clh
    pilots : Buffer     float32 (levels, pixels, 2): variance and relative variance of a sample
    n_levels : uint32
    """

    plan: cl.Buffer
    pilots: cl.Buffer
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
            memory.allocate("pilots", 8 * n_levels * n_pixels, zero=True),
            np.uint32(n_levels),
        )

    def send(
        self, queue: cl.CommandQueue, starts: NDArray[np.int64], first: NDArray[np.int64]
    ) -> None:
        """Make a step the plan: where each pixel's paths start, (pixels + 1,), and with which
        sample, (pixels,), in tile order."""
        cl.enqueue_copy(queue, self.plan, np.concatenate([starts, first]).astype(np.uint32))

    def read_pilots(
        self, queue: cl.CommandQueue, level: int, shape: tuple[int, int]
    ) -> NDArray[np.float32]:
        """The pilots of a level, (H, W, 2)."""
        pilots = np.empty((*shape, 2), np.float32)
        cl.enqueue_copy(queue, pilots, self.pilots, src_offset=level * pilots.nbytes)
        return pilots

    def clear(self, queue: cl.CommandQueue) -> None:
        """Forget all samples."""
        for buffer in (self.plan, self.pilots):
            fill(queue, buffer, 0, buffer.size)


class SamplePlan:
    """Decides step by step how many samples each pixel takes, and cuts steps into waves.

    Parameters
    ----------
    film : Film             with the buffers of a plan
    even : bool             all pixels take the same number
    target : Target or None         error to stop at
    stops : ints            samples of every pixel at which a step ends; at most as many as the
                            first plan rests on

    Attributes
    ----------
    counts : (H, W) int64       samples of each pixel when the step under way is done
    steps : int                 steps so far
    """

    def __init__(
        self,
        memory: Memory,
        film: Film,
        even: bool = False,
        target: Target | None = None,
        stops: Sequence[int] = (),
    ) -> None:
        if film.plan is None:
            raise ValueError("the film has no buffers of a plan")
        self._memory, self._queue = memory, memory.device.queue
        self._film, self._buffers = film, film.plan
        self._even, self._target, self._stops = even, target, stops
        self._order = tile_order(film.width, film.height)
        colour = allocation.checkerboard(film.height, film.width)
        self._colours = (colour, ~colour) if film.width * film.height > 1 else (colour,)
        self._others = self._colours[::-1]
        self.counts = np.zeros((film.height, film.width), np.int64)
        self.restart()

    def restart(self) -> None:
        """Forget all samples."""
        self.counts[:] = 0
        self.steps = 0
        # Samples a pixel, on average: that the step under way ends with, that the target needs and
        # that the render ends with; each for both colours.
        self._goals = [0.0 for _ in self._colours]
        self._needed = [math.inf for _ in self._colours]
        self._ends = list(self._goals)
        self._level = 0
        self._weights: NDArray[np.float64] | None = None
        self._starts = np.zeros(self.counts.size + 1, np.int64)
        self._first = np.zeros(self.counts.size, np.int64)
        self._done = 0

    def numbers(self) -> dict[str, Any]:
        """What it has to remember between two waves beside `parts`, as JSON values."""
        return {
            "steps": self.steps,
            "goals": self._goals,
            # JSON has no infinity.
            "needed": [None if math.isinf(needed) else needed for needed in self._needed],
            "ends": self._ends,
            "level": self._level,
            "done": self._done,
        }

    def parts(self) -> dict[str, cl.Buffer | np.ndarray]:
        """The arrays of what it has to remember."""
        return {
            "counts": self.counts,
            "plan": self._buffers.plan,
            "pilots": self._buffers.pilots,
        }

    def go_on(self, numbers: Mapping[str, Any]) -> None:
        """Go on with `numbers`, after `parts` were filled; weights follow from the pilots."""
        self.steps, self._level, self._done = (numbers[n] for n in ("steps", "level", "done"))
        self._goals, self._ends = numbers["goals"], numbers["ends"]
        self._needed = [math.inf if needed is None else needed for needed in numbers["needed"]]
        self._weights = None
        n_pixels = self.counts.size
        step = self._memory.read(self._buffers.plan, 2 * n_pixels + 1, np.uint32).astype(np.int64)
        self._starts, self._first = step[: n_pixels + 1], step[n_pixels + 1 :]

    @property
    def paths_needed(self) -> int:
        """Paths of the whole render, as far as is known."""
        sizes = [int(colour.sum()) for colour in self._colours]
        return round(sum(n * size for n, size in zip(self._ends, sizes, strict=True)))

    def cut(self, wave: np.ndarray, most: int, spp: int) -> int:
        """Fill in which paths a wave holds: the next of the step, or of a new one.

        Parameters
        ----------
        wave : struct Wave
        most : int          paths that it may hold
        spp : int           samples a pixel, on average, that the render ends with at the latest

        Returns
        -------
        int     pixels in tile order from the wave's first to its last; 0 if there is nothing to do
        """
        while self._done == self._starts[-1]:
            if not self._begin_step(spp):
                return 0
        n_paths = min(most, int(self._starts[-1]) - self._done)
        paths = np.array([self._done, self._done + n_paths - 1])
        first, last = np.searchsorted(self._starts, paths, side="right") - 1
        wave["n_paths"] = n_paths
        wave["first_pixel"] = first
        wave["first_sample"] = self._first[first] + self._done - self._starts[first]
        self._done += n_paths
        return int(last - first) + 1

    def _begin_step(self, spp: int) -> bool:
        """Plan the next step and send it to the device; false if the render has what it needs."""
        before = self._goals
        if self._target and before[0] >= allocation.pilot_samples(0):
            self._ask_what_is_needed(self._target)
        self._ends = [min(float(spp), needed) for needed in self._needed]
        if all(goal >= end for goal, end in zip(before, self._ends, strict=True)):
            return False
        most = MOST_PATHS // self.counts.size
        growth = allocation.STEP_GROWTH_TO_TARGET if self._target else allocation.STEP_GROWTH
        self._goals = [
            max(goal, min(end, goal + most, self._next_stop(goal, growth)))
            for goal, end in zip(before, self._ends, strict=True)
        ]
        taken = self.counts
        self.counts = self._plan(before)
        self.steps += 1
        new = (self.counts - taken).ravel()[self._order]
        self._starts = np.concatenate([[0], np.cumsum(new)])
        self._first = taken.ravel()[self._order]
        self._done = 0
        self._buffers.send(self._queue, self._starts, self._first)
        return True

    def _next_stop(self, goal: float, growth: float) -> float:
        """Samples a pixel, on average, that a step which begins with `goal` ends with at most."""
        stops = [float(stop) for stop in self._stops if stop > goal]
        return min([allocation.next_goal(goal, growth), *stops])

    def _ask_what_is_needed(self, target: Target) -> None:
        """Samples a pixel, on average, that each colour needs: those that bring the error of the
        other colour, which says nothing of one's own samples, to the target.

        A colour that has what it needed is not asked again, or it would be asked the more often
        the longer the other goes on, which is a matter of its own samples.
        """
        mean, variance, _ = self._film.read(self._memory)
        errors = target.squared_errors(mean, variance)
        self._needed = [
            needed if needed <= goal else target.needed(errors[other], self.counts[other])
            for needed, goal, other in zip(self._needed, self._goals, self._others, strict=True)
        ]

    def _plan(self, before: list[float]) -> NDArray[np.int64]:
        """The numbers of samples that the next step ends with."""
        if self._even or before[0] < allocation.pilot_samples(0):
            return self._shares(np.ones(self.counts.shape))
        level = allocation.level_of_step(
            self._level, int(self._buffers.n_levels), min(before), min(self._goals)
        )
        if level > self._level:
            self._level, self._goals, self._weights = level, before, None
            return np.maximum(self.counts, allocation.pilot_samples(level))
        if self._weights is None:
            pilots = self._buffers.read_pilots(self._queue, level, self.counts.shape)
            relative = self._target is not None and self._target.relative
            self._weights = allocation.weights(pilots, relative)
        return self._shares(self._weights)

    def _shares(self, weights: NDArray[np.float64]) -> NDArray[np.int64]:
        """Numbers in proportion to weights, each colour by itself."""
        counts = self.counts.copy()
        for mine, goal in zip(self._colours, self._goals, strict=True):
            total = round(goal * int(mine.sum()))
            least = allocation.EVEN_SHARE * goal
            counts[mine] = allocation.allot(weights[mine], counts[mine], total, least)
        return counts


def tile_order(width: int, height: int) -> NDArray[np.int64]:
    """Indices, row by row, of the pixels in the order in which paths take them: strips of eight
    rows, column by column, as in kernels/include/core/paths.clh."""
    index = np.arange(width * height).reshape(height, width)
    return np.concatenate([index[y : y + 8].T.ravel() for y in range(0, height, 8)])
