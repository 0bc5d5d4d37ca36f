"""A film in numpy for plans of samples, with values of which the truth is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from furcl.device import layout
from furcl.device.layout import RELATIVE_EPSILON
from furcl.rendering.allocation import n_levels, pilot_samples
from furcl.rendering.plan import SamplePlan


class HostFilm:
    """Takes the place of Film and its PlanBuffers.

    Parameters
    ----------
    values : (H, W, n)      the samples of each pixel, in their order
    """

    def __init__(self, values: Any) -> None:
        self.values = values
        self.height, self.width, n = values.shape
        self.n_levels = n_levels(n, self.width * self.height)
        self.counts: Any = np.zeros(values.shape[:2], np.int64)
        self.plan = self
        self.sums, self.squares = np.cumsum(values, 2), np.cumsum(values**2, 2)

    def send(self, queue, starts, first):
        pass

    def read_pilots(self, queue, level, shape):
        m = pilot_samples(level)
        assert self.counts.min() >= m
        head = self.values[..., :m]
        variance = head.var(axis=2, ddof=1)
        return np.stack([variance, variance / (head.mean(axis=2) ** 2 + RELATIVE_EPSILON)], 2)

    def read(self, memory=None):
        """Mean, variance of the mean, samples, as Film.read."""
        last = np.maximum(self.counts - 1, 0)[..., None]
        n = self.counts[..., None]
        mean = np.take_along_axis(self.sums, last, 2) / n
        squares = np.take_along_axis(self.squares, last, 2) / n - mean**2
        with np.errstate(divide="ignore", invalid="ignore"):
            variance = np.where(n > 1, squares / (n - 1), np.nan)
        return np.repeat(mean, 3, 2), np.repeat(variance, 3, 2), self.counts


def rendered(values, spp, even=False, target=None):
    """The film after a render of `spp` samples a pixel or to a target, and its plan."""
    film: Any = HostFilm(values)
    memory: Any = SimpleNamespace(device=SimpleNamespace(queue=None))
    plan = SamplePlan(memory, film, even, target)
    wave = np.zeros((), layout.struct_dtype("Wave"))
    paths = 0
    while paths < spp * film.counts.size and plan.cut(wave, 1 << 40, spp):
        paths += int(wave["n_paths"])
        film.counts = plan.counts
    assert paths == film.counts.sum()
    return film, plan
