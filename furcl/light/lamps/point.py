"""Lamps without extent: points and spots. Kernel: light/lamps/point.clh.

Their `radiance` is an intensity. A spot sends all of it within its inner cone, none outside the
outer one, and between them the part 3 x^2 - 2 x^3, x linear in the cosine with the axis.
"""

from __future__ import annotations

import numpy as np

from furcl.light.lamps.record import Array, Records, dot, is_kind, length, unit
from furcl.light.sample import LightSamples


def spot_share(lamps: Records, directions: Array) -> Array:
    """Part of the intensity (n,) that is sent against directions (n, 3) to the lamps."""
    cosine = -dot(directions, lamps["axis"])
    inner, outer = lamps["cos_inner"], lamps["cos_outer"]
    width = np.where(inner > outer, inner - outer, 1.0)
    x = np.clip((cosine - outer) / width, 0.0, 1.0)
    share = np.where(cosine >= inner, 1.0, np.where(cosine <= outer, 0.0, x * x * (3.0 - 2.0 * x)))
    return np.where(is_kind(lamps, "spot"), share, 1.0)


def spot_solid_angle(cos_inner: float, cos_outer: float) -> float:
    """Integral of a spot's share over all directions [sr]: the soft edge counts half."""
    return 2.0 * np.pi * ((1.0 - cos_inner) + 0.5 * (cos_inner - cos_outer))


def sample(lamps: Records, points: Array) -> LightSamples:
    """The direction to each lamp (n,) from points (n, 3): of density 1, or 0 where it is dark."""
    way = lamps["centre"] - points
    distances = length(way)
    directions = unit(way)
    share = spot_share(lamps, directions)
    radiance = share[:, None] * lamps["radiance"] / np.maximum(distances**2, 1e-30)[:, None]
    return LightSamples(directions, distances, radiance, (share > 0.0).astype(np.float64))
