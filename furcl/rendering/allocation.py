"""How many samples each pixel takes: in proportion to its standard deviation, without bias.

Among all ways to spend a number of samples, n_i in proportion to the standard deviation s_i of a
sample of pixel i has the least mean squared error (Neyman 1934). s_i is estimated; if a pixel's own
samples took part, a pixel whose first samples missed what is bright would take few more, and the
mean would be too dark. So pixels are coloured like a checkerboard, and a pixel's number depends on
pixels of the other colour alone, and of those on their first samples alone, whose number is fixed
(`pilot_samples`): it is independent of the pixel's own samples, and the mean of that many samples
is unbiased, exactly. docs/allocation.md has the argument in full.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import PILOT_GROWTH, PILOT_SAMPLES

#: Standard deviation of the Gaussian by which neighbours' deviations are averaged, and its reach
#: [pixels].
SMOOTHING_PX = 2.0
REACH_PX = 6

#: Samples a pixel that a step ends with, over those that it begins with: a render that is stopped
#: within a step has some pixels with the numbers of its end and some with those of its beginning.
#: Every step also ends with bounces of few paths, which cost a GPU more than small steps are worth.
STEP_GROWTH = 2.0

#: The same where a step is followed by the question whether the error is small enough.
STEP_GROWTH_TO_TARGET = 1.5

#: Part of the samples that is spread evenly, at least.
EVEN_SHARE = 1 / 16

#: A plan rests on the first samples of pixels if those are not more than this part of the samples.
PILOT_SHARE = 1 / 8

#: Levels of pilots that are kept: the last is that of 1,024 samples.
MOST_LEVELS = 5


def pilot_samples(level: int) -> int:
    """The number of a pixel's first samples whose variance is kept at a level."""
    return PILOT_SAMPLES * PILOT_GROWTH**level


def n_levels(spp: int, n_pixels: int) -> int:
    """Levels that a render of so many samples a pixel can use; their paths fit 32 bits."""
    levels = 1
    while (
        levels < MOST_LEVELS
        and pilot_samples(levels) <= PILOT_SHARE * spp
        and pilot_samples(levels) * n_pixels < 1 << 31
    ):
        levels += 1
    return levels


def next_goal(goal: float, growth: float = STEP_GROWTH) -> float:
    """Samples a pixel, on average, that a step ends with at most which begins with `goal`."""
    return max(float(pilot_samples(0)), float(math.ceil(growth * goal)))


def level_of_step(level: int, n_levels: int, before: float, goal: float) -> int:
    """Level of the pilots that a step from `before` to `goal` samples a pixel rests on.

    A new level wants all pixels to have its samples first, at worst as many more for each as the
    levels differ by; together that must not be more than the step has. Nothing here depends on
    what the samples were.
    """
    reached = pilot_samples(level)
    while (
        level + 1 < n_levels
        and pilot_samples(level + 1) <= PILOT_SHARE * goal
        and before + pilot_samples(level + 1) - reached <= goal
    ):
        level += 1
    return level


def checkerboard(height: int, width: int) -> NDArray[np.bool_]:
    """The pixels of one colour; the others are of the other, (height, width)."""
    return np.add.outer(np.arange(height), np.arange(width)) % 2 == 0


def of_other_colour(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of the neighbours of the other colour, weighted by a Gaussian of the distance.

    Parameters
    ----------
    values : (H, W)     one a pixel, finite

    Returns
    -------
    (H, W)      0 where there is no neighbour of the other colour: in a picture of one pixel
    """
    colour = checkerboard(*values.shape)
    out = np.zeros_like(values)
    for mine in (colour, ~colour):
        total, weight = _smooth(np.where(mine, 0.0, values)), _smooth(np.where(mine, 0.0, 1.0))
        np.divide(total, weight, out=out, where=mine & (weight > 0.0))
    return out


def _smooth(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums over neighbours with the weights of the Gaussian; nothing lies beyond the border."""
    offsets = np.arange(-REACH_PX, REACH_PX + 1)
    weights = np.exp(-0.5 * (offsets / SMOOTHING_PX) ** 2)
    for axis in (0, 1):
        width = [(0, 0), (0, 0)]
        width[axis] = (REACH_PX, REACH_PX)
        padded, n = np.pad(values, width), values.shape[axis]
        values = np.zeros_like(values)
        for k, weight in enumerate(weights):
            part = slice(k, k + n)
            values += weight * (padded[part] if axis == 0 else padded[:, part])
    return values


def weights(pilots: NDArray[np.float32], relative: bool = False) -> NDArray[np.float64]:
    """What the numbers of samples are to be in proportion to.

    Parameters
    ----------
    pilots : (H, W, 2)      of each pixel's first samples: variance and relative variance of a
                            sample; what is not finite counts as no variance
    relative : bool         for the least relative error

    Returns
    -------
    (H, W)      standard deviation of the neighbours of the other colour
    """
    variance = np.nan_to_num(pilots[..., int(relative)].astype(np.float64), posinf=0.0)
    # Roots before means: one pixel that met something bright by chance weighs less.
    return of_other_colour(np.sqrt(variance))


def allot(
    weights: NDArray[np.float64], taken: NDArray[np.int64], total: int, least: float
) -> NDArray[np.int64]:
    """Numbers of samples in proportion to weights, none below what is taken or least.

    Parameters
    ----------
    weights : (n,)      >= 0; all zero: evenly
    taken : (n,)        samples that are there already
    total : int         sum of the numbers that are returned, unless more are taken already
    least : float       number that every pixel gets if `total` allows it

    Returns
    -------
    (n,) int64          >= taken
    """
    new = total - int(taken.sum())
    if new <= 0:
        return taken
    floor = np.maximum(taken, least)
    if floor.sum() >= total or not weights.any():
        weights, floor = np.ones_like(weights), taken.astype(np.float64)
    share = _filled(weights, floor, total) - taken
    # Rounded so that all sums from the first pixel on are right within one half.
    ends = np.cumsum(share)
    ends = np.floor(ends * (new / ends[-1]) + 0.5).astype(np.int64)
    ends[-1] = new
    return taken + np.diff(ends, prepend=0)


def _filled(
    weights: NDArray[np.float64], floor: NDArray[np.float64], total: float
) -> NDArray[np.float64]:
    """max(floor, c weights) with the c whose sum is `total`, which is not below that of floor."""
    with np.errstate(divide="ignore", invalid="ignore"):
        reached_at = np.where(weights > 0.0, floor / weights, np.inf)
    order = np.argsort(reached_at, kind="stable")
    inside, outside = np.cumsum(weights[order]), floor.sum() - np.cumsum(floor[order])
    usable = np.isfinite(reached_at[order])
    sums = np.where(usable, reached_at[order] * inside + outside, np.inf)
    last = max(int(np.searchsorted(sums, total, side="right")) - 1, 0)
    return np.maximum(floor, (total - outside[last]) / inside[last] * weights)
