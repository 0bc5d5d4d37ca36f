"""What sampling a light gives, on the host: the twin of kernels/include/light/sample.clh."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LightSamples(NamedTuple):
    """Directions towards a light, one for each of n points.

    Attributes
    ----------
    directions : (n, 3) float64     unit, from the point to the light
    distances : (n,) float64        to the light, which nothing beyond it can shade; inf where it
                                    comes from infinity
    radiance : (n, 3) float64       that comes from there if nothing is between
    pdf : (n,) float64              density of the direction per solid angle [1/sr]
    """

    directions: Array
    distances: Array
    radiance: Array
    pdf: Array


def from_infinity(directions: Array, radiance: Array, pdf: Array) -> LightSamples:
    """Samples (n) of a light that has no place."""
    return LightSamples(directions, np.full(len(directions), np.inf), radiance, pdf)


def around_z(one_minus_cos: Array, turns: Array) -> Array:
    """Unit vectors (n, 3) at 1 - cos(theta) = one_minus_cos in [0, 2] and an azimuth in turns, z
    along the axis."""
    one_minus_cos = np.clip(one_minus_cos, 0.0, 2.0)
    level = np.sqrt(one_minus_cos * (2.0 - one_minus_cos))
    phi = 2.0 * math.pi * turns
    return np.stack([level * np.cos(phi), level * np.sin(phi), 1.0 - one_minus_cos], axis=1)
