"""Timing side by side: ratios of what took turns, on machines whose speed drifts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

CONFIDENCE = 0.95

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Median:
    """A median of n values with its interval; low and high are None where n allows none."""

    median: float
    low: float | None
    high: float | None
    n: int


@dataclass(frozen=True, eq=False)
class Seconds:
    """What an action took in every round, (rounds,) [s]; `cpu` is that of all threads."""

    wall: NDArray[np.float64]
    cpu: NDArray[np.float64]


def alternating(names: Iterable[K], rounds: int) -> Iterator[K]:
    """All names in every round; every second round goes through them backwards."""
    order = list(names)
    for i in range(rounds):
        yield from order[:: 1 if i % 2 == 0 else -1]


def in_turns(actions: Mapping[K, Callable[[], object]], rounds: int) -> dict[K, Seconds]:
    """Time actions that take turns.

    Ratios of processor seconds are the steadier ones on a machine that others use; for what runs on
    a GPU they say nothing.
    """
    seconds: dict[K, list[tuple[float, float]]] = {name: [] for name in actions}
    for name in alternating(actions, rounds):
        wall, cpu = time.perf_counter(), time.process_time()
        actions[name]()
        seconds[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: Seconds(*np.array(times).T) for name, times in seconds.items()}


def median_interval(values: ArrayLike, confidence: float = CONFIDENCE) -> Median:
    """The median and the narrowest pair of values that hold it with at least that confidence.

    Of n independent values the number below the true median is binomial, whatever their
    distribution: each end leaves out as many values as the confidence allows. Fewer than 6 values
    allow no interval of 95 %.
    """
    x = np.sort(np.asarray(values, np.float64).ravel())
    n, ends = len(x), 0  # values at each end that may lie beyond the median, one more than left out
    outside = 0.0
    while ends < n // 2:
        outside += 2.0 * math.comb(n, ends) * 0.5**n
        if outside > 1.0 - confidence:
            break
        ends += 1
    low, high = (float(x[ends - 1]), float(x[-ends])) if ends else (None, None)
    return Median(float(np.median(x)), low, high, n)
