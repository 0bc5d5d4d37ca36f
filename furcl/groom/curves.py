"""Curves: the strands of a groom as flat arrays, checked once and never changed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import GroomError
from furcl.groom.attributes import Attributes, checked_values, kept_values
from furcl.groom.close_points import squared_lengths, without_short_segments
from furcl.groom.copies import copied_strands
from furcl.groom.motion import checked_times, time_steps, without_short_in_all_steps
from furcl.groom.units import NO_UNITS, Units

MAX_POINTS = 2**31 - 1
# Squares of coordinates and radii within these limits stay normal float32 numbers.
MAX_MAGNITUDE = 1e18
MIN_MAGNITUDE = 1e-18
THIN_RADII = "radii_below_1e-18"  # what `dropped` calls those that were raised to it
POINTS_AT_ONCE = 1 << 18  # more would be copied in float64 at a time

# What mends a groom without radii.
ADVICE = (
    "Give the radius of the strands in the units of the file: default_radius = R in [curves] of a "
    "scene, --default-radius R to furcl info and convert."
)


@dataclass(frozen=True, eq=False, repr=False)
class Curves:
    """Strands with a radius per point, joined by straight segments.

    Build one with :meth:`from_arrays`, which checks and cleans; the arrays are read-only.

    Attributes
    ----------
    points : (N, 3) float32      positions [scene unit], strand after strand, root to tip
    radii : (N,) float32         radii, never widths [scene unit], > 0
    offsets : (S + 1,) int64     strand s owns points[offsets[s]:offsets[s + 1]], at least two
    dropped : mapping            what cleaning removed: name -> count, only counts > 0
    attributes : mapping         name -> float32: (N,) or (N, 3) values of points, or (S,) or (S, 3)
                                 values of strands
    ignored : tuple of str       names of arrays of its file that are no attributes
    units : Units                what its file says of units and axes
    steps : (T, N, 3) float32 or None   positions at `times`, of a groom that moves; points are
                                 those of the first. Between times points go straight
    times : tuple of T floats    increasing; of a groom that keeps still none
    """

    points: NDArray[np.float32]
    radii: NDArray[np.float32]
    offsets: NDArray[np.int64]
    dropped: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    attributes: Attributes = field(default_factory=lambda: MappingProxyType({}))
    ignored: tuple[str, ...] = ()
    units: Units = NO_UNITS
    steps: NDArray[np.float32] | None = None
    times: tuple[float, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """For pickle and copy, which take neither a proxy of a mapping nor the flags of arrays."""
        arrays = (self._positions, self.radii, self.offsets)
        named = (dict(self.attributes), dict(self.dropped), self.ignored, self.units, self.times)
        return _frozen, (*arrays, *named)

    @property
    def _positions(self) -> NDArray[np.float32]:
        """The steps of a groom that moves, or the points of one that does not."""
        return self.points if self.steps is None else self.steps

    def __repr__(self) -> str:
        named = f", with {', '.join(self.attributes)}" if self.attributes else ""
        if self.times:
            named += f", {len(self.times)} steps of time {self.times[0]:g} to {self.times[-1]:g}"
        return (
            f"Curves({self.n_strands} strands, {self.n_points} points, radii "
            f"{self.radii.min():.4g} to {self.radii.max():.4g}{named})"
        )

    @property
    def n_strands(self) -> int:
        """Number of strands."""
        return len(self.offsets) - 1

    @property
    def n_points(self) -> int:
        """Number of points of all strands."""
        return len(self.points)

    @property
    def n_segments(self) -> int:
        """Number of straight segments of all strands."""
        return self.n_points - self.n_strands

    @property
    def n_bytes(self) -> int:
        """Size of the arrays in bytes."""
        arrays = (self._positions, self.radii, self.offsets, *self.attributes.values())
        return sum(a.nbytes for a in arrays)

    @property
    def colours(self) -> NDArray[np.float32] | None:
        """The attribute of that name, linear RGB: (N, 3) of points, or (S, 3) of strands."""
        return self.attributes.get("colours")

    @property
    def one_radius(self) -> bool:
        """Whether all points have the same radius, to the bit."""
        return bool((self.radii == self.radii[0]).all())

    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Corners (lo, hi) of the box around all points, each widened by its radius; of a groom
        that moves around those of the first step."""
        lo, hi = np.full(3, np.inf), np.full(3, -np.inf)
        for begin in range(0, self.n_points, POINTS_AT_ONCE):
            part = slice(begin, begin + POINTS_AT_ONCE)
            radii = self.radii[part].astype(np.float64)
            for axis in range(3):
                x = self.points[part, axis]
                lo[axis] = min(lo[axis], (x - radii).min())
                hi[axis] = max(hi[axis], (x + radii).max())
        return lo, hi

    def segment_vertices(self) -> NDArray[np.int32]:
        """First vertex of every segment, (n_segments,): segment i joins vertex v and v + 1."""
        first = np.ones(self.n_points, dtype=bool)
        first[self.offsets[1:] - 1] = False
        return np.flatnonzero(first).astype(np.int32)

    def traced(self) -> "Curves":
        """The groom as rays meet it; itself, where that is the same.

        Points nearer to the one before than 1/32 of the radius (furcl.groom.close_points) and
        copies of earlier strands (furcl.groom.copies) are left out and counted in `dropped`; where
        the groom moves, what is so in all time steps.

        Raises
        ------
        GroomError                   where nothing is left
        """
        traced = self
        if self.steps is None:
            thinned = without_short_segments(self.points, self.radii, self.offsets)
        else:
            thinned = without_short_in_all_steps(self.steps, self.radii, self.offsets)
        if thinned is not None:
            if not len(thinned.kept):
                raise GroomError("curves: the groom is empty: all strands are single points.")
            dropped = dict(self.dropped)
            for name, count in thinned.dropped.items():
                dropped[name] = dropped.get(name, 0) + count
            traced = _frozen(
                thinned.points,
                self.radii[thinned.kept],
                thinned.offsets,
                kept_values(self.attributes, self.offsets, thinned.kept),
                dropped,
                self.ignored,
                self.units,
                self.times,
            )
        copies = copied_strands(traced.points, traced.radii, traced.offsets, traced.steps)
        if not len(copies):
            return traced
        kept = np.ones(traced.n_strands, bool)
        kept[copies] = False
        return traced.with_strands(kept, "copied_strands")

    def with_steps(self, steps: Sequence[NDArray[np.float32]], times: Sequence[float]) -> "Curves":
        """The groom with other points (N, 3): at each of some times, or at one, still there."""
        still = len(times) == 1
        return _frozen(
            steps[0].view() if still else np.stack(steps),
            self.radii,
            self.offsets,
            dict(self.attributes),
            self.dropped,
            self.ignored,
            self.units,
            () if still else tuple(times),
        )

    def with_strands(self, kept: NDArray[np.bool_], reason: str) -> "Curves":
        """The groom of those strands alone, at least one, of `kept` (S,); how many are left out is
        in `dropped` under the name `reason`."""
        counts = np.diff(self.offsets)
        points = np.flatnonzero(np.repeat(kept, counts))
        n_gone = int(np.count_nonzero(~kept))
        return _frozen(
            self._positions[..., points, :],
            self.radii[points],
            np.concatenate([[0], np.cumsum(counts[kept])]).astype(np.int64),
            kept_values(self.attributes, self.offsets, points),
            {**self.dropped, reason: self.dropped.get(reason, 0) + n_gone},
            self.ignored,
            self.units,
            self.times,
        )

    @staticmethod
    def from_checked(
        points: NDArray[np.float32],
        radii: NDArray[np.float32],
        offsets: NDArray[np.int64],
        dropped: Mapping[str, int],
        times: tuple[float, ...] = (),
    ) -> "Curves":
        """A groom of arrays that are as `from_arrays` leaves them; they become read-only. With
        times points are (T, N, 3)."""
        return _frozen(points, radii, offsets, {}, dropped, times=times)

    @staticmethod
    def from_arrays(
        points: ArrayLike,
        radii: ArrayLike,
        offsets: ArrayLike | None = None,
        *,
        source: str = "curves",
        colours: ArrayLike | None = None,
        dropped: Mapping[str, int] | None = None,
        attributes: Mapping[str, ArrayLike] | None = None,
        ignored: Sequence[str] = (),
        times: ArrayLike | None = None,
    ) -> "Curves":
        """Check arrays, drop what is harmless and make a groom of the rest.

        A point that repeats the point before it and its radius (a segment shorter than 1e-18) is
        dropped, and so is a strand whose points are all one; both are counted in `dropped`. Radii
        below 1e-18, such as 0 at a tip, become 1e-18, which no ray meets, and are counted too.
        The groom has its own copy: what is written to the arrays later does not reach it.

        Parameters
        ----------
        points : (N, 3)              finite, magnitude at most 1e18; or (S, K, 3): S strands of K;
                                     of a groom that moves (T, N, 3) or (T, S, K, 3), T times
        radii : (N,) or scalar       0 .. 1e18, not all 0; for strands of K points (S, K) or scalar
        offsets : (S + 1,) integers  0 = offsets[0] <= ... <= offsets[S] = N; left out for strands
                                     of K points
        source : str                 the name used in messages, a path for files
        colours : (N, 3) or (S, 3)   the attribute of that name, or None
        dropped : mapping            counts of things that the caller has already left out
        attributes : mapping         name -> finite values of points, (N,) or (N, 3), or of strands,
                                     (S,) or (S, 3); for strands of K points those of points are
                                     (S, K) or (S, K, 3)
        ignored : sequence of str    names of arrays that the caller has left out
        times : (T,)                 increasing; from 0 to 1, evenly, if left out

        Raises
        ------
        GroomError                   names the source, the strand and the point
        """
        points, radii = _array(points, "points", source), _array(radii, "radii", source)
        named = {} if colours is None else {"colours": colours}
        named |= attributes or {}
        curves = adopted(
            points,
            radii,
            offsets,
            source=source,
            dropped=dropped,
            attributes=named,
            ignored=ignored,
            times=times,
        )
        given = [points, radii, *(np.asarray(array) for array in named.values())]
        given += [] if offsets is None else [np.asarray(offsets)]

        def own(array):
            # One array may stand for several, so each is compared with all.
            shared = any(np.may_share_memory(array, other) for other in given)
            return array.copy() if shared else array

        return _frozen(
            own(curves._positions),
            own(curves.radii),
            own(curves.offsets),
            {name: own(values) for name, values in curves.attributes.items()},
            curves.dropped,
            curves.ignored,
            curves.units,
            curves.times,
        )


def adopted(
    points: ArrayLike,
    radii: ArrayLike,
    offsets: ArrayLike | None = None,
    *,
    source: str = "curves",
    dropped: Mapping[str, int] | None = None,
    attributes: Mapping[str, ArrayLike] | None = None,
    ignored: Sequence[str] = (),
    units: Units = NO_UNITS,
    times: ArrayLike | None = None,
) -> Curves:
    """As `Curves.from_arrays`, of arrays that nobody else keeps: what fits is not copied.

    Raises
    ------
    GroomError      as `Curves.from_arrays`
    """
    each = time_steps(points, offsets)
    if each is None:
        each, moments = [points], ()
        if times is not None:
            raise GroomError(
                f"{source}: times are given, and points of shape {np.shape(points)} have no axis "
                f"of time. Give (T, N, 3) beside offsets or counts, or (T, S, K, 3)."
            )
    else:
        moments = checked_times(times, len(each), source)
    grid = np.shape(each[0])[:2] if offsets is None else None
    first, radii, offsets = _shaped(each[0], radii, offsets, source)
    _check_offsets(offsets, len(first), source)
    points = _all_steps(points, first.shape, source) if moments else first
    for step in points if moments else [points]:
        _check_points(step, offsets, source)
    radii, n_thin = _checked_radii(radii, offsets, source)
    values = checked_values(attributes or {}, offsets, grid, source)
    points, radii, offsets, values, cleaned = _clean(points, radii, offsets, values, source)
    found = {**(dropped or {}), **cleaned}
    found[THIN_RADII] = max(n_thin, found.get(THIN_RADII, 0))
    return _frozen(points, radii, offsets, values, found, tuple(ignored), units, moments)


def _all_steps(points, shape, source):
    """Points of all time steps, (T, N, 3) float32."""
    array = _numbers(points, "points", source)
    return _float32(array).reshape(len(array), *shape)


def _frozen(
    points,
    radii,
    offsets,
    attributes,
    dropped,
    ignored=(),
    units=NO_UNITS,
    times=(),
) -> Curves:
    """`points` are (T, N, 3) where there are times."""
    for array in (points, radii, offsets, *attributes.values()):
        array.flags.writeable = False
    counts = {name: count for name, count in dropped.items() if count > 0}
    values = MappingProxyType(dict(attributes))
    steps = points if times else None
    points = points[0] if times else points
    counts = MappingProxyType(counts)
    return Curves(points, radii, offsets, counts, values, ignored, units, steps, times)


def _shaped(points, radii, offsets, source):
    """Views of the inputs with the documented shapes and types."""
    points = _numbers(points, "points", source)
    radii = _numbers(radii, "radii", source)
    if offsets is None and points.ndim == 3 and points.shape[2] == 3:
        points, radii, offsets = _flattened(points, radii, source)
    if offsets is None:
        raise GroomError(
            f"{source}: there are no offsets, and points of shape {points.shape} do not say where "
            "strands begin. Give offsets, or points (S, K, 3) of S strands of K points."
        )
    offsets = _array(offsets, "offsets", source)
    if points.ndim != 2 or points.shape[1] != 3:
        raise GroomError(
            f"{source}: points has shape {points.shape}; expected (N, 3), one row x y z per point, "
            "or (S, K, 3) without offsets."
        )
    n = len(points)
    if n > MAX_POINTS:
        raise GroomError(
            f"{source}: {n} points; at most {MAX_POINTS} can be indexed. Split the groom."
        )
    if radii.ndim != 0 and radii.shape != (n,):
        raise GroomError(
            f"{source}: radii has shape {radii.shape}; expected ({n},), one per point, or a scalar."
        )
    if offsets.ndim != 1 or offsets.dtype.kind not in "iu":
        raise GroomError(
            f"{source}: offsets has shape {offsets.shape} and type {offsets.dtype}; expected a "
            "flat array of integers, one per strand and a last one."
        )
    radii = _float32(np.broadcast_to(radii, (n,)))
    if offsets.dtype == np.uint64 and offsets.size and offsets.max() > MAX_POINTS:
        raise GroomError(f"{source}: an offset of {offsets.max()} points beyond the {n} points.")
    offsets = np.ascontiguousarray(offsets, dtype=np.int64).view()
    return _float32(points), radii, offsets


def _flattened(points, radii, source):
    """Strands of equally many points as flat arrays with offsets."""
    shape = points.shape[:2]
    if radii.ndim and radii.shape != shape:
        raise GroomError(
            f"{source}: radii has shape {radii.shape}; expected {shape}, as the points have."
        )
    offsets = np.arange(shape[0] + 1, dtype=np.int64) * shape[1]
    return points.reshape(-1, 3), radii.ravel() if radii.ndim else radii, offsets


def _array(values, name, source):
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise GroomError(f"{source}: {name} is no array: {error}. Give numbers.") from None


def _numbers(values, name, source):
    array = _array(values, name, source)
    if array.dtype.kind not in "fiu":
        raise GroomError(f"{source}: {name} has type {array.dtype}; expected real numbers.")
    return array


def _float32(array):
    """A contiguous float32 view or copy; what overflows becomes infinite and is refused later."""
    with np.errstate(over="ignore", under="ignore"):
        return np.ascontiguousarray(array, dtype=np.float32).view()


def _place(source, offsets, vertex):
    strand = int(np.searchsorted(offsets, vertex, side="right")) - 1
    return f"{source}: strand {strand}, point {vertex - int(offsets[strand])}"


def _check_offsets(offsets, n_points, source):
    if len(offsets) < 2 or n_points == 0:
        raise GroomError(
            f"{source}: the groom is empty ({max(len(offsets) - 1, 0)} strands, {n_points} "
            "points); at least one strand of two points is needed."
        )
    if offsets[0] != 0 or offsets[-1] != n_points:
        raise GroomError(
            f"{source}: the offsets run from {offsets[0]} to {offsets[-1]}; they must run from 0 "
            f"to the number of points, {n_points}. Rewrite them as the running sum of the counts."
        )
    counts = np.diff(offsets)
    short = np.flatnonzero(counts < 2)
    if len(short):
        strand, count = int(short[0]), int(counts[short[0]])
        if count < 0:
            raise GroomError(
                f"{source}: strand {strand} ends before it begins (offset {offsets[strand]} then "
                f"{offsets[strand + 1]}); offsets must not decrease."
            )
        raise GroomError(
            f"{source}: strand {strand} has {count} point{'s' * (count != 1)}; a strand needs at "
            f"least 2. {len(short)} such strands: remove them or export them with more points."
        )


def _check_points(points, offsets, source):
    # min and max carry NaN along, so this pass allocates nothing.
    if points.min() >= -MAX_MAGNITUDE and points.max() <= MAX_MAGNITUDE:
        return
    bad = np.flatnonzero(~(np.abs(points) <= MAX_MAGNITUDE).all(axis=1))
    x, y, z = (float(v) for v in points[bad[0]])
    raise GroomError(
        f"{_place(source, offsets, int(bad[0]))} is ({x:g}, {y:g}, {z:g}); coordinates must be "
        f"finite and at most {MAX_MAGNITUDE:g}. {len(bad)} such points: repair the export."
    )


def _checked_radii(radii, offsets, source):
    """Radii of at least MIN_MAGNITUDE, and how many were raised to it."""
    if radii.min() >= MIN_MAGNITUDE and radii.max() <= MAX_MAGNITUDE:
        return radii, 0
    bad = np.flatnonzero(~((radii >= 0.0) & (radii <= MAX_MAGNITUDE)))
    if len(bad):
        raise GroomError(
            f"{_place(source, offsets, int(bad[0]))}: radius {float(radii[bad[0]]):g}; radii must "
            f"be finite, from 0 to {MAX_MAGNITUDE:g}. {len(bad)} such points: repair the widths of "
            "the export."
        )
    thin = radii < MIN_MAGNITUDE
    if thin.all():
        raise GroomError(
            f"{_place(source, offsets, 0)}: radius {float(radii[0]):g}; no radius is above "
            f"{MIN_MAGNITUDE:g}, so there is nothing to see. {len(radii)} such points. {ADVICE}"
        )
    return np.where(thin, np.float32(MIN_MAGNITUDE), radii), int(np.count_nonzero(thin))


def _clean(points, radii, offsets, values, source):
    """Drop repeated points, then strands of which only one point is left; of points (T, N, 3) what
    is so in all time steps."""
    repeated = np.ones(points.shape[-2], dtype=bool)
    for step in points.reshape(-1, *points.shape[-2:]):
        repeated[1:] &= squared_lengths(step) < MIN_MAGNITUDE**2
    repeated[offsets[:-1]] = False
    if not repeated.any():
        return points, radii, offsets, values, {}
    counts = np.diff(offsets)
    collapsed = np.add.reduceat(repeated, offsets[:-1], dtype=np.int64) == counts - 1
    # Where the radius makes a step, both points stay.
    repeated[1:] &= (radii[1:] == radii[:-1]) | np.repeat(collapsed, counts)[1:]
    counts -= np.add.reduceat(repeated, offsets[:-1], dtype=np.int64)
    keep = ~repeated
    keep[offsets[:-1][collapsed]] = False
    if not keep.any():
        raise GroomError(
            f"{source}: the groom is empty: all points of each of its {len(counts)} strands are "
            "the same point; check the scale and the precision of the export."
        )
    values = kept_values(values, offsets, np.flatnonzero(keep))
    offsets = np.concatenate([[0], np.cumsum(counts[~collapsed])]).astype(np.int64)
    dropped = {
        "zero_length_segments": int(np.count_nonzero(repeated)),
        "collapsed_strands": int(np.count_nonzero(collapsed)),
    }
    return points[..., keep, :], radii[keep], offsets, values, dropped
