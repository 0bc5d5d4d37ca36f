"""Lamps that are spheres, of radius `extent`. Kernel: light/lamps/sphere.clh.

They shine outwards alike in all directions; inside it is dark. They are sampled uniformly in the
cone that they fill as seen from a point.
"""

from __future__ import annotations

import numpy as np

from furcl.light.lamps.record import (
    Array,
    Records,
    cone_density,
    cone_directions,
    dot,
    length,
    unit,
)
from furcl.light.sample import LightSamples


def _cones(lamps: Records, distances: Array) -> Array:
    """1 - cos of the angular radius (n,); 0 inside."""
    sine = lamps["extent"] / np.maximum(distances, np.finfo(np.float64).tiny)
    outside = np.minimum(sine, 1.0)
    return np.where(sine < 1.0, outside**2 / (1.0 + np.sqrt(1.0 - outside**2)), 0.0)


def density(lamps: Records, points: Array) -> Array:
    """Density [1/sr] (n,) of the directions in which points see the lamps."""
    return cone_density(_cones(lamps, length(lamps["centre"] - points)))


def sample(lamps: Records, points: Array, u: Array) -> LightSamples:
    """A direction to each lamp (n,) from points (n, 3), by uniform numbers (n, 2)."""
    way = lamps["centre"] - points
    distance = length(way)
    edge = _cones(lamps, distance)
    one_minus_cos = u[:, 0] * edge
    aside = distance**2 * one_minus_cos * (2.0 - one_minus_cos)
    near = distance * (1.0 - one_minus_cos) - np.sqrt(np.maximum(lamps["extent"] ** 2 - aside, 0.0))
    directions = cone_directions(unit(way), one_minus_cos, u[:, 1])
    return LightSamples(directions, near, lamps["radiance"].copy(), cone_density(edge))


def hit(lamps: Records, origins: Array, directions: Array) -> Array:
    """Distance (n,) at which each ray meets its lamp, from inside too; inf where it does not."""
    way = lamps["centre"] - origins
    along = dot(way, directions)
    chord = lamps["extent"] ** 2 - length(way - along[:, None] * directions) ** 2
    half = np.sqrt(np.maximum(chord, 0.0))
    t = np.where(along - half > 0.0, along - half, along + half)
    return np.where((chord >= 0.0) & (t > 0.0), t, np.inf)


def bounds(lamps: Records) -> tuple[Array, Array]:
    """Corners (n, 3) of boxes around each lamp, lower and upper."""
    radius = lamps["extent"][:, None]
    return lamps["centre"] - radius, lamps["centre"] + radius
