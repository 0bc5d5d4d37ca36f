"""Points closer together than a fibre is thick can tell where it is, but not where it goes.

A ray meets the round end of every segment, so even the shortest one is seen as a disc as wide as
the fibre; and if it is no longer than a small part of the radius, rounding or a careless export
decides which way the disc's tangent goes. So such segments are taken out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Segments shorter than this part of the larger of their radii are taken out.
SHORTEST = 1.0 / 32.0
#: Points no farther apart are the same one [unit]; the square of it is still a normal float32.
SAME = 1e-18

_AT_ONCE = 1 << 18  # points whose steps are looked at together


@dataclass(frozen=True, eq=False)
class Thinned:
    """A groom without short segments.

    Attributes
    ----------
    kept : (n,) int64           numbers of the points that are left
    points : (n, 3) float32     where they are
    offsets : (s + 1,) int64    as of furcl.groom.curves.Curves
    dropped : dict              counts: zero_length_segments, short_segments, collapsed_strands
    """

    kept: NDArray[np.int64]
    points: NDArray[np.float32]
    offsets: NDArray[np.int64]
    dropped: dict[str, int]


def without_short_segments(
    points: NDArray[np.float32], radii: NDArray[np.float32], offsets: NDArray[np.int64]
) -> Thinned | None:
    """Take out segments shorter than SHORTEST of the larger radius; None if there are none.

    Of two points that are too close the second goes. Where the radius changes by more than SHORTEST
    between them, both stay, so that a step stays a step, and the second is moved along the strand,
    by half as much or less: then the segment between them goes where the strand goes. A strand
    keeps two points, unless all of its points are the same; then it goes as a whole. What is left
    has nothing to take out.

    Parameters
    ----------
    points : (n, 3) float32, radii : (n,) float32, offsets : (s + 1,) int64
        as of furcl.groom.curves.Curves, every strand with two points or more
    """
    short = _short(points, radii)
    short[offsets[1:-1] - 1] = False
    if not short.any():
        return None
    groom = _Groom(points, radii, offsets)
    changed = True
    while changed:
        changed = groom.drop_short()
        changed |= groom.move_steps()
        changed |= groom.drop_same()
    return groom.result()


class _Groom:
    """A groom while it is thinned; a segment has the number of its first point."""

    def __init__(self, points, radii, offsets) -> None:
        self._points, self._radii = points, radii
        self._kept = np.arange(len(points))
        self._strand = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
        self._counts = np.diff(offsets)
        self._step = np.zeros(len(points), bool)  # segments that are short because of a step
        self._dropped = {"zero_length_segments": 0, "short_segments": 0}

    def drop_short(self) -> bool:
        """Drop points and mark steps until there are no other short segments."""
        changed = False
        while True:
            short = _short(self._points, self._radii) & self._inside() & ~self._step[:-1]
            short &= self._counts[self._strand[1:]] > 2
            # every other one of a run: what goes is next to what stays
            segment = np.flatnonzero(short & (_place_in_run(short) % 2 == 0))
            if not len(segment):
                return changed
            a, b = self._radii[segment], self._radii[segment + 1]
            is_step = np.abs(b - a) > SHORTEST * np.maximum(a, b)
            self._step[segment[is_step]] = True
            self._drop(segment[~is_step])
            changed |= not is_step.all()

    def drop_same(self) -> bool:
        """Drop points that are where the one before them is, whatever their radius."""
        changed = False
        while True:
            same = (squared_lengths(self._points) < SAME**2) & self._inside()
            segment = np.flatnonzero(same & (_place_in_run(same) % 2 == 0))
            if not len(segment):
                return changed
            self._drop(segment)
            changed = True

    def move_steps(self) -> bool:
        """Put the second points of steps on the way to the next point that is farther away, or
        where a strand ends with steps, on the way from the one before."""
        steps = np.flatnonzero(self._step)
        if not len(steps):
            return False
        place = _place_in_run(self._step)[steps]
        begin = steps - place  # first point of its run of steps, ...
        runs = np.flatnonzero(place == 0)
        n = np.diff(np.append(runs, len(steps)))
        end = begin + np.repeat(n, n)  # ... and the last one
        inside = np.concatenate([[False], self._inside(), [False]])  # ends at this point
        onward, back = inside[end + 1], inside[begin]
        to = np.where(onward, np.minimum(end + 1, len(self._points) - 1), begin)
        since = np.where(onward | ~back, begin, begin - 1)
        way = self._points[to].astype(np.float64) - self._points[since]
        length = np.linalg.norm(way, axis=1)
        known = length > 0.0
        reach = SHORTEST * np.maximum(self._radii[steps], self._radii[steps + 1])
        reach = np.repeat(np.minimum.reduceat(reach.astype(np.float64), runs), n)
        reach = np.minimum(0.5 * reach, 0.25 * length / (end - begin))
        shift = ((place + 1) * reach)[known, None] * way[known] / length[known, None]
        moved = self._points.copy()
        moved[steps[known] + 1] = self._points[begin[known]] + shift
        changed = not np.array_equal(moved, self._points)
        self._points = moved
        return changed

    def result(self) -> Thinned:
        left = self._counts > 1
        on = left[self._strand]
        dropped = {**self._dropped, "collapsed_strands": int(np.count_nonzero(~left))}
        offsets = np.concatenate([[0], np.cumsum(self._counts[left])]).astype(np.int64)
        return Thinned(self._kept[on], self._points[on], offsets, dropped)

    def _inside(self) -> NDArray[np.bool_]:
        """Which pairs of neighbours are of one strand, (n - 1,)."""
        return self._strand[1:] == self._strand[:-1]

    def _drop(self, segment) -> None:
        """Drop the second points of segments of which none follows another."""
        same = squared_lengths(self._points)[segment] < SAME**2
        self._dropped["zero_length_segments"] += int(np.count_nonzero(same))
        self._dropped["short_segments"] += int(np.count_nonzero(~same))
        gone = segment + 1
        self._step[segment] = False  # whether it is short now is to be seen
        self._counts = self._counts - np.bincount(self._strand[gone], minlength=len(self._counts))
        for name in ("_points", "_radii", "_kept", "_strand", "_step"):
            setattr(self, name, np.delete(getattr(self, name), gone, axis=0))


def squared_lengths(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Squares of the distances between neighbours, (n - 1,)."""
    # By component: three passes over one column are faster than one over rows of three.
    length_sq = np.zeros(max(len(points) - 1, 0), np.float32)
    with np.errstate(under="ignore"):
        for axis in range(3):
            along = np.diff(points[:, axis])
            length_sq += along * along
    return length_sq


def _short(points: NDArray[np.float32], radii: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which neighbours are too close to each other, (n - 1,); strands are not told apart."""
    short = np.empty(max(len(points) - 1, 0), bool)
    for begin in range(0, len(short), _AT_ONCE):
        part = slice(begin, min(begin + _AT_ONCE, len(short)) + 1)
        reach = np.maximum(radii[part][:-1], radii[part][1:]) * np.float32(SHORTEST)
        reach = np.maximum(reach, np.float32(SAME))
        short[part.start : part.stop - 1] = squared_lengths(points[part]) < reach * reach
    return short


def _place_in_run(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Of every flag that is set, how many set ones are right before it."""
    at = np.arange(len(flags))
    return at - np.maximum.accumulate(np.where(flags, -1, at)) - 1
