"""Flat lamps: parallelograms, ellipses and triangles. Kernel: light/lamps/planar.clh.

The points of a lamp are centre + u a + v b: |u|, |v| <= 1 of a quad, u^2 + v^2 <= 1 of a disk, and
of a triangle, whose corner is the centre, u, v >= 0 with u + v <= 1. They shine alike in all
directions of the side to which the axis points, or of both, and are sampled uniformly by area.
Triangles are those of meshes, which the rays of kernels meet in their place.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from furcl.light.lamps.layout import TRIANGLE_MARGIN
from furcl.light.lamps.record import Array, Records, dot, is_kind, length, records, unit
from furcl.light.sample import LightSamples

# Area over |a x b|.
AREAS = {"quad": 4.0, "disk": np.pi, "triangle": 0.5}


def flat(
    kind: str,
    centre: ArrayLike,
    a: ArrayLike,
    b: ArrayLike,
    radiance: ArrayLike,
    *,
    two_sided: bool = False,
    flip: bool = False,
) -> Records:
    """Lamps of a kind of AREAS.

    Parameters
    ----------
    centre, a, b : (3,) or (n, 3)
    radiance : (3,) or (n, 3)
    two_sided : bool
    flip : bool                 the axis is - a x b, not a x b

    Returns
    -------
    (n,) records                those of no area are left out
    """
    centre, a, b = (np.atleast_2d(np.asarray(v, np.float64)) for v in (centre, a, b))
    normal = np.cross(a, b)
    size = length(normal)
    square = np.maximum(size**2, np.finfo(np.float64).tiny)[:, None]
    out = records(
        kind,
        len(centre),
        centre=centre,
        axis=unit(-normal if flip else normal),
        a=a,
        b=b,
        a_dual=np.cross(b, normal) / square,
        b_dual=np.cross(normal, a) / square,
        extent=AREAS[kind] * size,
        two_sided=float(two_sided),
        radiance=radiance,
    )
    return out[size > 0.0]


def _places(lamps: Records, u: Array) -> Array:
    """(u, v) of each lamp (n, 2), uniform by area."""
    turn, root = 2.0 * np.pi * u[:, 1], np.sqrt(u[:, 0])
    disk = root[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    triangle = np.stack([1.0 - root, root * u[:, 1]], axis=1)
    places = np.where(is_kind(lamps, "disk")[:, None], disk, 2.0 * u - 1.0)
    return np.where(is_kind(lamps, "triangle")[:, None], triangle, places)


def density(lamps: Records, directions: Array, distances: Array) -> Array:
    """Density [1/sr] (n,) of directions in which a point sees each lamp; 0 of the dark side."""
    cosine = -dot(directions, lamps["axis"])
    cosine = np.where(lamps["two_sided"] > 0.0, np.abs(cosine), cosine)
    seen = cosine > 0.0
    return np.where(seen, distances**2 / (lamps["extent"] * np.where(seen, cosine, 1.0)), 0.0)


def sample(lamps: Records, points: Array, u: Array) -> LightSamples:
    """A direction to each lamp (n,) from points (n, 3), by uniform numbers (n, 2)."""
    place = _places(lamps, u)
    way = lamps["centre"] - points + place[:, :1] * lamps["a"] + place[:, 1:] * lamps["b"]
    directions, distances = unit(way), length(way)
    densities = density(lamps, directions, distances)
    size = distances + length(lamps["a"]) + length(lamps["b"])
    cosine = np.maximum(np.abs(dot(directions, lamps["axis"])), np.finfo(np.float64).tiny)
    margin = np.where(is_kind(lamps, "triangle"), TRIANGLE_MARGIN * size / cosine, 0.0)
    reach = np.maximum(distances - margin, 0.0)
    return LightSamples(directions, reach, lamps["radiance"].copy(), densities)


def hit(lamps: Records, origins: Array, directions: Array) -> Array:
    """Distance (n,) at which each ray meets its lamp; inf where it does not."""
    way = lamps["centre"] - origins
    with np.errstate(divide="ignore", invalid="ignore"):
        t = dot(way, lamps["axis"]) / dot(directions, lamps["axis"])
        place = t[:, None] * directions - way
        u, v = dot(place, lamps["a_dual"]), dot(place, lamps["b_dual"])
        inside = (np.abs(u) <= 1.0) & (np.abs(v) <= 1.0)
        inside = np.where(is_kind(lamps, "disk"), u**2 + v**2 <= 1.0, inside)
        triangle = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
        inside = np.where(is_kind(lamps, "triangle"), triangle, inside)
        return np.where(inside & (t > 0.0), t, np.inf)


def bounds(lamps: Records) -> tuple[Array, Array]:
    """Corners (n, 3) of boxes around each lamp, lower and upper."""
    a, b = lamps["a"], lamps["b"]
    disk, triangle = (is_kind(lamps, kind)[:, None] for kind in ("disk", "triangle"))
    reach = np.where(disk, np.hypot(a, b), np.abs(a) + np.abs(b))
    lower = np.where(triangle, np.minimum(np.minimum(a, b), 0.0), -reach)
    upper = np.where(triangle, np.maximum(np.maximum(a, b), 0.0), reach)
    return lamps["centre"] + lower, lamps["centre"] + upper
