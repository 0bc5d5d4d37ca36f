"""Grooms that move: their points at two or more times, straight ways between them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import GroomError
from furcl.groom.close_points import Thinned, without_short_segments

if TYPE_CHECKING:
    from furcl.groom.curves import Curves

Span = tuple[float, float]
"""When the shutter opens and closes; the same twice: no time passes."""

#: The shutter of a camera of which nothing else is said: a still picture of time 0.
NOT_SAID: Span = (0.0, 0.0)

log = logging.getLogger(__name__)

#: Points of strands are on the device for so many time steps at most, ends of the shutter included.
MOST_STEPS = 65


def time_steps(points: Any, offsets: Any) -> list[Any] | None:
    """Points of each time step, where an array has an axis of time: (T, N, 3) with offsets, or
    (T, S, K, 3) without; None: it has none."""
    axes = 3 if offsets is not None else 4
    if np.ndim(points) != axes or np.shape(points)[-1] != 3:
        return None
    return list(points)


def checked_times(times: ArrayLike | None, n_steps: int, source: str) -> tuple[float, ...]:
    """The times of time steps; from 0 to 1, evenly, where none are given.

    Raises
    ------
    GroomError      fewer than two steps, another number of times, or times that do not increase
    """
    if n_steps < 2:
        raise GroomError(
            f"{source}: points have an axis of time with {n_steps} step{'s' * (n_steps != 1)}; a "
            f"groom that moves needs two or more. Leave that axis out of one that does not."
        )
    if times is None:
        return tuple(np.linspace(0.0, 1.0, n_steps).tolist())
    try:
        given = np.asarray(times)
    except (TypeError, ValueError) as error:
        raise GroomError(f"{source}: times is no array: {error}. Give numbers.") from None
    if given.dtype.kind not in "fiu" or given.shape != (n_steps,):
        raise GroomError(
            f"{source}: times has shape {given.shape} and type {given.dtype}; expected "
            f"{n_steps} numbers, one for each time step of the points."
        )
    given = given.astype(np.float64)
    if not (np.isfinite(given).all() and (np.diff(given) > 0.0).all()):
        wrong = ", ".join(f"{time:g}" for time in given[:8])
        raise GroomError(
            f"{source}: times = {wrong}{', ...' * (n_steps > 8)}; they must be finite and each "
            f"larger than the one before. Put the time steps in order, and leave out doubles."
        )
    return tuple(given.tolist())


def check_within(span: Span, times: Sequence[float], source: str) -> None:
    """Refuse a shutter that is open while nobody says where a groom or a camera is.

    Raises
    ------
    GroomError
    """
    if not times[0] <= span[0] <= span[1] <= times[-1]:
        raise GroomError(
            f"{source}: its times are {times[0]:g} to {times[-1]:g}, and the camera's shutter is "
            f"open from {span[0]:g} to {span[1]:g}; set camera.shutter within them, or add times."
        )


def points_at(curves: Curves, time: float) -> NDArray[np.float32]:
    """The points (N, 3) of a groom at a time, straight between its time steps."""
    if curves.steps is None:
        return curves.points
    times = np.asarray(curves.times)
    piece = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2))
    part = (time - times[piece]) / (times[piece + 1] - times[piece])
    before, after = curves.steps[piece], curves.steps[piece + 1]
    if part in (0.0, 1.0):
        return after if part else before
    return ((1.0 - part) * before + part * after).astype(np.float32)


def times_within(times: Sequence[float], span: Span) -> list[float]:
    """The ends of a span, once if it has no length, and those times that lie between."""
    opens, closes = span
    return sorted({opens, closes, *(time for time in times if opens < time < closes)})


def during(curves: Curves, span: Span, source: str = "curves") -> Curves:
    """A groom for as long as a shutter is open: with time steps where that opens and closes, or
    still, as it is then, where no time passes.

    NOT_SAID, where its times do not begin before that, sees it as it is at its first time: those
    of animations are often numbers of frames.

    Raises
    ------
    GroomError      a span beyond the groom's times
    """
    if curves.steps is None:
        return curves
    if span == NOT_SAID and curves.times[0] > 0.0:
        log.info(
            "%s: as it is at time %g, its first; camera.shutter says another",
            source,
            curves.times[0],
        )
        span = (curves.times[0], curves.times[0])
    check_within(span, curves.times, source)
    times = times_within(curves.times, span)
    if tuple(times) == curves.times:
        return curves
    return curves.with_steps([points_at(curves, time) for time in times], times)


def without_short_in_all_steps(
    steps: NDArray[np.float32], radii: NDArray[np.float32], offsets: NDArray[np.int64]
) -> Thinned | None:
    """Take out of a groom that moves the points that `without_short_segments` takes out of every
    one of its time steps (T, N, 3), of which the points that are left are (T, n, 3); None if there
    are none."""
    each = [without_short_segments(points, radii, offsets) for points in steps]
    kept = np.zeros(len(radii), bool)
    places = steps.copy()
    for step, thinned in enumerate(each):
        if thinned is None:
            return None
        kept[thinned.kept] = True
        places[step, thinned.kept] = thinned.points
    # A strand that is a point in one step and none in another keeps two points at least.
    counts = np.add.reduceat(kept, offsets[:-1], dtype=np.int64)
    dropped = {
        "short_segments": int(np.count_nonzero(~kept)),
        "collapsed_strands": int(np.count_nonzero(counts == 0)),
    }
    number = np.flatnonzero(kept)
    offsets = np.concatenate([[0], np.cumsum(counts[counts > 0])]).astype(np.int64)
    return Thinned(number, np.ascontiguousarray(places[:, number]), offsets, dropped)
