"""Lamps at infinity: a cone of directions against the axis. Kernel: light/lamps/distant.clh.

`extent` is 1 - cos of the cone's angular radius. Where it is 0, `radiance` is the irradiance of a
surface that faces the lamp, and light samples alone find it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from furcl.light.lamps.record import Array, Records, cone_density, cone_directions, length
from furcl.light.sample import LightSamples, from_infinity


def inside(lamps: Records, directions: Array) -> NDArray[np.bool_]:
    """Whether directions (n, 3) are in the cones of lamps (n,)."""
    return length(directions + lamps["axis"]) ** 2 <= 2.0 * lamps["extent"]


def density(lamps: Records) -> Array:
    """Density (n,) of directions to the lamps [1/sr]; 1 of those without a width."""
    return np.where(lamps["extent"] > 0.0, cone_density(lamps["extent"]), 1.0)


def sample(lamps: Records, u: Array) -> LightSamples:
    """A direction to each lamp (n,), by uniform numbers (n, 2)."""
    directions = cone_directions(-lamps["axis"], u[:, 0] * lamps["extent"], u[:, 1])
    return from_infinity(directions, lamps["radiance"].copy(), density(lamps))
