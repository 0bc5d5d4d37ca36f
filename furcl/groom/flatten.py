"""Cubic curves as polylines, with points only where they bend.

A span of a curve is brought into the Bezier basis, with its radius as a fourth coordinate, and cut
in halves until its two inner control points are no farther from the straight segment between its
ends than the tolerance. A cubic lies in the convex hull of its control points, all of whose points
are then as near, so curve and segment are nowhere farther apart, and the radius errs by no more
either. tests/test_flatten.py measures it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from furcl.errors import GroomError

if TYPE_CHECKING:
    from furcl.groom.formats.format import Strands

Array = NDArray[np.float64]

#: The tolerance is the larger of this share of the largest radius of a strand ...
RADIUS_SHARE = 0.25
#: ... and this share of the length of its control polygon.
LENGTH_SHARE = 1e-4
TOLERANCE = "the larger of a quarter of the strand's largest radius and 1/10,000 of its length"
#: Control points that are flattened at once: bounds the memory that it takes, some kB each.
AT_ONCE = 1 << 12
#: Halvings of a span; by then its inner control points are within LENGTH_SHARE in any case.
MAX_DEPTH = 10

_BEZIER = {
    "bezier": np.eye(4),
    "bspline": np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6.0,
    "catmull-rom": np.array([[0, 6, 0, 0], [-1, 6, 1, 0], [0, 1, 6, -1], [0, 0, 6, 0]]) / 6.0,
}


class Spans:
    """The cubic spans of strands of control points.

    Attributes
    ----------
    offsets : (S + 1,) int64        strand s has the spans offsets[s] to offsets[s + 1]
    varying_offsets : (S + 1,)      and so many values that belong to the ends of spans
    """

    def __init__(
        self,
        offsets: NDArray[np.integer],
        basis: str,
        wrap: str = "nonperiodic",
        source: str = "curves",
    ) -> None:
        """
        Parameters
        ----------
        offsets : (S + 1,)      strand s owns the control points offsets[s] to offsets[s + 1]
        basis : str             "bezier", "bspline" or "catmull-rom"
        wrap : str              "nonperiodic"; "periodic", a closed curve; "pinned", which adds a
                                control point at either end so that the curve reaches its ends
        source : str            the name in messages

        Raises
        ------
        GroomError              a number of control points that makes no spans
        """
        counts = np.diff(np.asarray(offsets, np.int64))
        wrap = "nonperiodic" if basis == "bezier" and wrap == "pinned" else wrap
        n_spans = _span_counts(counts, basis, wrap, source)
        self._matrix = _BEZIER[basis]
        self._pinned = wrap == "pinned"
        self._control_offsets = np.asarray(offsets, np.int64)
        self.offsets = np.concatenate([[0], np.cumsum(n_spans)])
        self.strand = np.repeat(np.arange(len(counts)), n_spans)
        local = np.arange(self.offsets[-1]) - self.offsets[self.strand]
        first = local * (3 if basis == "bezier" else 1) - self._pinned
        self._local = first[:, None] + np.arange(4)
        if wrap == "periodic":
            self._local %= counts[self.strand][:, None]
        closed = wrap == "periodic"
        self.varying_offsets = self.offsets + (0 if closed else np.arange(len(counts) + 1))
        ends = local[:, None] + np.arange(2)
        if closed:
            ends %= n_spans[self.strand][:, None]
        self._ends = self.varying_offsets[self.strand][:, None] + ends

    def bezier(self, values: NDArray[np.floating]) -> Array:
        """Bezier coefficients (n, 4, ...) of values at the control points."""
        return np.einsum("ij,nj...->ni...", self._matrix, self._controls(values))

    def bezier_of_ends(self, values: NDArray[np.floating]) -> Array:
        """Bezier coefficients (n, 4, ...) of values at the ends of spans, linear between."""
        a, b = np.moveaxis(np.asarray(values, np.float64)[self._ends], 1, 0)
        return np.stack([a, a + (b - a) / 3.0, b - (b - a) / 3.0, b], axis=1)

    def _controls(self, values):
        values = np.asarray(values, np.float64)
        base = self._control_offsets[self.strand][:, None]
        if not self._pinned:
            return values[base + self._local]
        # The points before the first and after the last of a strand: 2 P0 - P1, 2 Pn - Pn-1.
        count = np.diff(self._control_offsets)[self.strand][:, None]
        inside = np.clip(self._local, 0, count - 1)
        found = values[base + inside]
        step = np.where(self._local < 0, 1, np.where(self._local >= count, -1, 0))
        return np.where(
            (step == 0).reshape(step.shape + (1,) * (values.ndim - 1)),
            found,
            2.0 * found - values[base + inside + step],
        )


@dataclasses.dataclass(eq=False)
class Places:
    """Where the points of the polylines are on the curves.

    Attributes
    ----------
    span : (m,) int64           the span of a point
    t : (m,) float64            0 .. 1 in it
    offsets : (S + 1,) int64    as of furcl.groom.curves.Curves
    """

    span: NDArray[np.int64]
    t: Array
    offsets: NDArray[np.int64]

    def of(self, bezier: Array) -> NDArray[np.float32]:
        """Values (m, ...) at the points, of Bezier coefficients (n, 4, ...)."""
        u = 1.0 - self.t
        weights = np.stack([u**3, 3 * u * u * self.t, 3 * u * self.t**2, self.t**3])
        found = np.zeros((len(self.t), *bezier.shape[2:]))
        extra = (1,) * (bezier.ndim - 2)
        for i in range(4):
            found += weights[i].reshape(-1, *extra) * bezier[self.span, i]
        with np.errstate(over="ignore", under="ignore"):
            return found.astype(np.float32)


def places(spans: Spans, steps: Sequence[Array], radii: Array) -> Places:
    """Where points must be for polylines that keep the tolerance, at every step of time.

    Parameters
    ----------
    steps : arrays (n, 4, 3)    Bezier coefficients of the spans, of curves that keep still one
    radii : (n, 4)              those of the radii
    """
    tolerance = _tolerances(spans, steps[0], radii)
    span = np.arange(len(radii))
    at = np.zeros(len(span), np.int64)  # where a part begins, in units of 2^-MAX_DEPTH of its span
    parts = [np.concatenate([points, radii[:, :, None]], axis=2) for points in steps]
    found_span, found_at = [], []
    for depth in range(MAX_DEPTH + 1):
        with np.errstate(invalid="ignore", over="ignore"):
            # What is not finite is not cut: it is refused with the other points.
            bent = np.maximum.reduce([_distance(part) for part in parts]) > tolerance[span]
        if depth == MAX_DEPTH:
            bent[:] = False
        found_span.append(span[~bent])
        found_at.append(at[~bent])
        span, at = span[bent], at[bent]
        if not len(span):
            break
        parts = [np.concatenate(_halves(part[bent])) for part in parts]
        half = 1 << (MAX_DEPTH - depth - 1)
        span = np.concatenate([span, span])
        at = np.concatenate([at, at + half])
    span, at = np.concatenate(found_span), np.concatenate(found_at)
    order = np.lexsort((at, span))
    span, t = span[order], at[order] / (1 << MAX_DEPTH)
    # Parts stand for where they begin; a strand ends where its last span does.
    ends = np.searchsorted(span, spans.offsets[1:])
    span = np.insert(span, ends, spans.offsets[1:] - 1)
    t = np.insert(t, ends, 1.0)
    return Places(span, t, np.concatenate([[0], ends + np.arange(1, len(ends) + 1)]))


def flattened(strands: Strands, basis: str) -> Strands:
    """Strands whose points and values are at control points, as polylines.

    Raises
    ------
    GroomError      a number of control points that makes no spans
    """
    points = np.asarray(strands.points)
    offsets = strands.offsets
    if offsets is None:
        offsets = np.arange(len(points) + 1, dtype=np.int64) * points.shape[1]
    offsets = np.asarray(offsets, np.int64)
    points = points.reshape(-1, 3)
    radii = np.asarray(strands.radii, np.float64)
    radii = np.broadcast_to(radii.reshape(-1) if radii.ndim else radii, len(points))
    _span_counts(np.diff(offsets), basis, "nonperiodic", strands.source)
    values = {name: np.asarray(array) for name, array in strands.attributes.items()}
    of_points = {name: array for name, array in values.items() if len(array) != len(offsets) - 1}
    parts = [
        _flattened_part(
            points[part], radii[part], own, basis, {k: v[part] for k, v in of_points.items()}
        )
        for part, own in _blocks_of_strands(offsets)
    ]
    found, found_radii, counts, at_points = zip(*parts, strict=True)
    return dataclasses.replace(
        strands,
        points=np.concatenate(found),
        radii=np.concatenate(found_radii),
        offsets=np.concatenate([[0], np.cumsum(np.concatenate(counts))]),
        attributes=values | {k: np.concatenate([part[k] for part in at_points]) for k in of_points},
    )


def _blocks_of_strands(offsets: NDArray[np.int64]) -> Iterator[tuple[slice, NDArray[np.int64]]]:
    """Control points of whole strands, about AT_ONCE, and the offsets of these strands in them."""
    begin, n = 0, len(offsets) - 1
    while begin < n or n == 0:
        end = int(np.searchsorted(offsets, offsets[begin] + AT_ONCE, side="right")) - 1
        end = min(max(end, begin + 1), n)
        yield (
            slice(int(offsets[begin]), int(offsets[end])),
            offsets[begin : end + 1] - offsets[begin],
        )
        if n == 0:
            return
        begin = end


def _flattened_part(points, radii, offsets, basis, values):
    """Points, radii, points of each strand, and values of points, of some strands."""
    spans = Spans(offsets, basis)
    bezier_points, bezier_radii = spans.bezier(points), spans.bezier(radii)
    found = places(spans, [bezier_points], bezier_radii)
    return (
        found.of(bezier_points),
        # A cubic of radii above 0 may dip below between them.
        np.maximum(found.of(bezier_radii), 0.0),
        np.diff(found.offsets),
        {name: found.of(spans.bezier(array)) for name, array in values.items()},
    )


def _span_counts(counts, basis, wrap, source):
    if wrap == "periodic":
        fits = (counts % 3 == 0) & (counts >= 3) if basis == "bezier" else counts >= 3
        n_spans = counts // 3 if basis == "bezier" else counts
        rule = "a multiple of 3" if basis == "bezier" else "at least 3"
    elif wrap == "pinned":
        fits, n_spans, rule = counts >= 2, counts - 1, "at least 2"
    elif basis == "bezier":
        fits, n_spans = (counts % 3 == 1) & (counts >= 4), (counts - 1) // 3
        rule = "4, 7, 10 and so on: 3 a span and one more"
    else:
        fits, n_spans, rule = counts >= 4, counts - 3, "at least 4"
    if not fits.all():
        strand = int(np.argmin(fits))
        raise GroomError(
            f"{source}: strand {strand} has {counts[strand]} control points; a {wrap} {basis} "
            f"curve has {rule}. {np.count_nonzero(~fits)} such strands: correct the basis, or "
            "repair the export."
        )
    return n_spans


def _tolerances(spans, points, radii):
    """Of each span, that of its strand."""
    begin = spans.offsets[:-1]
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
        length = np.add.reduceat(steps, begin)
        radius = np.maximum.reduceat(radii.max(axis=1), begin)
        return np.maximum(RADIUS_SHARE * radius, LENGTH_SHARE * length)[spans.strand]


def _distance(part):
    """Of the inner control points of parts (n, 4, 4), the larger distance from the segment."""
    start, way = part[:, 0], part[:, 3] - part[:, 0]
    length_sq = (way * way).sum(axis=1)
    worst = np.zeros(len(part))
    for i in (1, 2):
        to = part[:, i] - start
        along = (to * way).sum(axis=1) / np.where(length_sq > 0.0, length_sq, 1.0)
        nearest = to - np.clip(along, 0.0, 1.0)[:, None] * way
        worst = np.maximum(worst, np.linalg.norm(nearest, axis=1))
    return worst


def _halves(part):
    """Both halves of Bezier parts (n, 4, k), by de Casteljau's construction."""
    a, b, c, d = (part[:, i] for i in range(4))
    ab, bc, cd = (a + b) / 2, (b + c) / 2, (c + d) / 2
    abc, bcd = (ab + bc) / 2, (bc + cd) / 2
    middle = (abc + bcd) / 2
    return np.stack([a, ab, abc, middle], 1), np.stack([middle, bcd, cd, d], 1)
