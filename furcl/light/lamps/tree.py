"""The tree over lamps that have a place, by which one of them is chosen for a point.

Halves are cut at the median along the longer side, so that the tree is balanced: with up to 2^24
lamps it is 24 levels deep. Nodes say how much light they may send to a point (Conty Estevez and
Kulla 2018, without their term of the receiver, since fibres have no normal): the largest
intensities of their lamps, summed, over the squared distance of the middle of their bounds, times
the cosine with the nearest axis that a lamp in it may have. The kernel: light/lamps/tree.clh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.light.lamps.record import Array, dot, length, unit

Whole = NDArray[np.int64]

NO_LAMP = -1
LEAST_DISTANCE_SQ = 1e-30
LARGEST_IMPORTANCE = 1e30

# Bounds are widened by what float32 may lose of coordinates and of sizes; edges of light [rad] by
# what it loses of cosines.
WIDEN = 1e-6
WIDEN_EDGE = 1e-3


@dataclass(frozen=True, eq=False)
class Emitters:
    """What the tree is built over, of n lamps.

    Attributes
    ----------
    lower, upper : (n, 3)   bounds
    intensity : (n,)        the largest, luminance [W / sr]
    axis : (n, 3)           unit; middle of a cone of directions around which it shines ...
    spread : (n,)           ... the cone's half angle, pi for all directions [rad] ...
    edge : (n,)             ... and how far beside these its light ends [rad]
    """

    lower: Array
    upper: Array
    intensity: Array
    axis: Array
    spread: Array
    edge: Array


@dataclass(frozen=True, eq=False)
class LampTree:
    """Nodes in the order of a walk: a node, its first half, its second half.

    Attributes
    ----------
    lower, upper : (m, 3)   bounds
    intensity : (m,)        sum over the lamps
    axis : (m, 3)           with cos_axis and cos_edge (m,) the cones of `Emitters`; cos_axis is -1
                            where there is light in all directions
    next : (m,)             node behind all that is in it; the first half of node i is i + 1, the
                            second next[i + 1]
    lamp : (m,)             of a leaf, else NO_LAMP
    trail : (n,)            of a lamp: bit k is 1 if at level k it is in the second half
    """

    lower: Array
    upper: Array
    intensity: Array
    axis: Array
    cos_axis: Array
    cos_edge: Array
    next: Whole
    lamp: Whole
    trail: Whole

    def importance(self, nodes: Whole, points: Array) -> Array:
        """What nodes (n,) send to points (n, 3), about [W / (sr m^2)]; 0: nothing."""
        lower, upper = self.lower[nodes], self.upper[nodes]
        way, half = points - 0.5 * (lower + upper), 0.5 * (upper - lower)
        distance_sq, radius_sq = dot(way, way), dot(half, half)
        narrow = (self.cos_axis[nodes] > -1.0) & (distance_sq > radius_sq)
        safe = np.where(narrow, distance_sq, 1.0)
        off = np.clip(dot(self.axis[nodes], way) / np.sqrt(safe), -1.0, 1.0)
        size = np.sqrt(np.clip(1.0 - radius_sq / safe, 0.0, 1.0))
        cosine = _cos_difference(_cos_difference(off, self.cos_axis[nodes]), size)
        dark = narrow & (cosine <= self.cos_edge[nodes])
        cosine = np.where(narrow, cosine, 1.0)
        least = np.maximum(radius_sq, LEAST_DISTANCE_SQ)
        value = self.intensity[nodes] * cosine / np.maximum(distance_sq, least)
        return np.where(dark, 0.0, np.minimum(value, LARGEST_IMPORTANCE))

    def _first_chance(self, nodes: Whole, points: Array, by_position: bool) -> Array:
        """Chance of the first half of inner nodes (n,); -1 where neither half sends anything."""
        first = nodes + 1
        second = self.next[first]
        if by_position:
            a, b = self.importance(first, points), self.importance(second, points)
        else:
            a, b = self.intensity[first], self.intensity[second]
        return np.where(a + b > 0.0, a / np.where(a + b > 0.0, a + b, 1.0), -1.0)

    def choose(self, points: Array, xi: Array, by_position: bool) -> tuple[Whole, Array]:
        """A lamp (n,) for each point (n, 3) by numbers (n, 4) in [0, 1), and its chance (n,); 0:
        there is none for the point. Each number serves eight levels."""
        xi, nodes, chance = xi.copy(), np.zeros(len(points), np.int64), np.ones(len(points))
        level = 0
        while (inner := np.flatnonzero((self.lamp[nodes] == NO_LAMP) & (chance > 0.0))).size:
            share = self._first_chance(nodes[inner], points[inner], by_position)
            column = level // 8 % 4
            number = xi[inner, column]
            take_first = number < share
            width = np.where(take_first, share, 1.0 - share)
            begin = np.where(take_first, 0.0, share)
            xi[inner, column] = (number - begin) / np.where(width > 0.0, width, 1.0)
            chance[inner] *= np.where(share < 0.0, 0.0, width)
            first = nodes[inner] + 1
            nodes[inner] = np.where(take_first, first, self.next[first])
            level += 1
        return np.maximum(self.lamp[nodes], 0), chance

    def chance(self, lamps: Whole, points: Array, by_position: bool) -> Array:
        """The chance (n,) with which `choose` takes a lamp (n,) for a point (n, 3)."""
        trail, nodes, chance = (
            self.trail[lamps],
            np.zeros(len(lamps), np.int64),
            np.ones(len(lamps)),
        )
        while (inner := np.flatnonzero(self.lamp[nodes] == NO_LAMP)).size:
            share = self._first_chance(nodes[inner], points[inner], by_position)
            second = (trail[inner] & 1).astype(bool)
            chance[inner] *= np.where(share < 0.0, 0.0, np.where(second, 1.0 - share, share))
            first = nodes[inner] + 1
            nodes[inner] = np.where(second, self.next[first], first)
            trail[inner] >>= 1
        return chance


def _cos_difference(cos_a: Array, cos_b: Array) -> Array:
    """cos of max(0, a - b), angles in [0, pi] given by their cosines."""
    sines = np.sqrt(np.maximum((1.0 - cos_a**2) * (1.0 - cos_b**2), 0.0))
    return np.where(cos_a >= cos_b, 1.0, cos_a * cos_b + sines)


def build(emitters: Emitters) -> LampTree:
    """The tree over n > 0 lamps, level by level: every step is one of numpy's for a whole level."""
    n = len(emitters.intensity)
    middle = 0.5 * (emitters.lower + emitters.upper)
    order = np.arange(n)
    trail = np.zeros(n, np.int64)
    next_node, lamp = np.zeros(2 * n - 1, np.int64), np.full(2 * n - 1, NO_LAMP)
    levels: list[Whole] = []
    nodes, begin, end = np.zeros(1, np.int64), np.zeros(1, np.int64), np.full(1, n)
    while nodes.size:
        next_node[nodes] = nodes + 2 * (end - begin) - 1
        leaf = end - begin == 1
        lamp[nodes[leaf]] = order[begin[leaf]]
        nodes, begin, end = nodes[~leaf], begin[~leaf], end[~leaf]
        if not nodes.size:
            break
        order = _sorted_along_longer_side(order, middle, begin, end)
        levels.append(nodes)
        half = begin + (end - begin + 1) // 2
        behind = order[_ranges(half, end)]
        trail[behind] |= 1 << (len(levels) - 1)
        children = np.stack([nodes + 1, nodes + 2 * (half - begin)], axis=1).ravel()
        begin, end = (
            np.stack([begin, half], axis=1).ravel(),
            np.stack([half, end], axis=1).ravel(),
        )
        nodes = children
    return _with_bounds(emitters, next_node, lamp, trail, levels)


def _ranges(begin: Whole, end: Whole) -> Whole:
    """begin[0], ..., end[0] - 1, begin[1], ...: whole numbers of all ranges, none of them empty."""
    sizes = end - begin
    starts = np.cumsum(sizes) - sizes
    return np.arange(sizes.sum()) + np.repeat(begin - starts, sizes)


def _sorted_along_longer_side(order: Whole, middle: Array, begin: Whole, end: Whole) -> Whole:
    """`order` with each of its ranges sorted along the axis on which the range is longest."""
    places = _ranges(begin, end)
    group = np.repeat(np.arange(len(begin)), end - begin)
    points = middle[order[places]]
    starts = np.searchsorted(group, np.arange(len(begin)))
    extent = np.maximum.reduceat(points, starts) - np.minimum.reduceat(points, starts)
    along = points[np.arange(len(points)), extent.argmax(axis=1)[group]]
    out = order.copy()
    out[places] = order[places][np.lexsort((along, group))]
    return out


def _with_bounds(
    emitters: Emitters, next_node: Whole, lamp: Whole, trail: Whole, levels: list[Whole]
) -> LampTree:
    """Bounds, intensities and cones of all nodes, from the leaves up."""
    m = len(lamp)
    lower, upper, axis = np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 3))
    intensity, spread, edge = np.zeros(m), np.zeros(m), np.zeros(m)
    leaf = lamp != NO_LAMP
    of = lamp[leaf]
    size = WIDEN * (np.abs(emitters.lower) + np.abs(emitters.upper))[of]
    lower[leaf], upper[leaf] = emitters.lower[of] - size, emitters.upper[of] + size
    intensity[leaf], axis[leaf] = emitters.intensity[of], emitters.axis[of]
    spread[leaf] = emitters.spread[of]
    edge[leaf] = np.minimum(emitters.edge[of] + WIDEN_EDGE, np.pi)
    for nodes in reversed(levels):
        first = nodes + 1
        second = next_node[first]
        lower[nodes] = np.minimum(lower[first], lower[second])
        upper[nodes] = np.maximum(upper[first], upper[second])
        intensity[nodes] = intensity[first] + intensity[second]
        edge[nodes] = np.maximum(edge[first], edge[second])
        axis[nodes], spread[nodes] = _cone_around(
            axis[first], spread[first], axis[second], spread[second]
        )
    everywhere = spread >= np.pi
    return LampTree(
        lower,
        upper,
        intensity,
        axis,
        np.where(everywhere, -1.0, np.cos(spread)),
        np.cos(edge),
        next_node,
        lamp,
        trail,
    )


def _cone_around(
    axis_a: Array, spread_a: Array, axis_b: Array, spread_b: Array
) -> tuple[Array, Array]:
    """Axes (n, 3) and half angles (n,) of cones around two cones each."""
    swap = (spread_b > spread_a)[:, None]
    wide, narrow = np.where(swap, axis_b, axis_a), np.where(swap, axis_a, axis_b)
    larger, smaller = np.maximum(spread_a, spread_b), np.minimum(spread_a, spread_b)
    between = 2.0 * np.arctan2(length(wide - narrow), length(wide + narrow))
    holds = between + smaller <= larger
    spread = np.where(holds, larger, 0.5 * (larger + between + smaller))
    aside = unit(narrow - dot(wide, narrow)[:, None] * wide)
    # Opposite axes have none: any other way round is as long.
    lost = length(aside) == 0.0
    other = np.where(np.abs(wide[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    aside = np.where(lost[:, None], unit(np.cross(wide, other)), aside)
    turn = (spread - larger)[:, None]
    axis = np.where(holds[:, None], wide, np.cos(turn) * wide + np.sin(turn) * aside)
    return axis, np.minimum(spread, np.pi)
