"""Where `furcl bench stability` looks at a fibre: points at the ends of their ranges.

Points mix the edges of inclination, offset and direction with numbers from anywhere between them.
Values are rounded to what float32 can hold, so that the device and the reference are given the same
numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAST = 1.0 - 2.0**-24
"""Largest number below 1 that float32 can hold."""

THETAS = tuple(
    math.radians(t) for t in (0, 1e-7, 30, 60, 80, 89, 89.9, 90 - 1e-3, 90 - 1e-5, 90 - 1e-7, 90)
)
OFFSETS = (0.0, 1e-7, 1e-3, 0.5, 0.99, 1 - 1e-6, LAST, 1.0)


@dataclass(frozen=True, eq=False)
class Points:
    """Points (n of each) at which a fibre is evaluated; every number is one of float32.

    Attributes
    ----------
    sin_cos : (n, 2)    sine and cosine of the inclination, for `Probe.attenuation`
    h : (n,)            offsets
    wo, wi : (n, 3)     directions in the fibre's frame, unit to float32
    """

    sin_cos: Array
    h: Array
    wo: Array
    wi: Array

    def __len__(self) -> int:
        return len(self.h)

    @property
    def theta(self) -> Array:
        """(n,) inclinations whose cosine is that of `sin_cos` to float64."""
        sine, cosine = self.sin_cos.T
        return np.arctan2(np.copysign(np.sqrt((1.0 - cosine) * (1.0 + cosine)), sine), cosine)


def points(edge: Callable[[Array], Array], rng: np.random.Generator, n: int) -> Points:
    """Random points, half of each coordinate at an edge.

    edge : of cosines of inclinations (n,), the offsets at which the attenuation has an edge
    """
    theta = _choose(rng, n, THETAS, rng.uniform(0.0, np.pi / 2, n)) * _signs(rng, n)
    sin_cos = _rounded(np.stack([np.sin(theta), np.cos(theta)], 1))
    h = _choose(rng, n, OFFSETS, rng.uniform(0.0, 1.0, n))
    # A quarter of the offsets graze that edge.
    graze = edge(sin_cos[:, 1]) * (1.0 + rng.choice([0, 1e-7, -1e-7, 1e-4, -1e-4], n))
    h = np.where((rng.random(n) < 0.25) & (graze <= 1.0), graze, h)
    h = _rounded(h * _signs(rng, n))
    phi = rng.uniform(-np.pi, np.pi, n)
    wo = _direction(theta, phi)
    # Towards wi: anywhere, near the mirror's cone, along the fibre, back, straight on.
    other = np.arcsin(rng.uniform(-1.0, 1.0, n))
    spread = np.exp(rng.uniform(np.log(1e-4), 0.0, n)) * rng.standard_normal(n)
    kind = rng.integers(0, 5, n)
    other = np.where(kind == 1, np.clip(-theta + spread, -np.pi / 2, np.pi / 2), other)
    other = np.where(kind == 2, _choose(rng, n, THETAS, other) * _signs(rng, n), other)
    other = np.where(kind >= 3, -theta, other)
    turn = rng.uniform(-np.pi, np.pi, n)
    turn = np.where(kind == 3, 0.0, np.where(kind == 4, np.pi, turn))
    return Points(sin_cos, h, wo, _direction(other, phi + turn))


def _direction(theta: Array, phi: Array) -> Array:
    c = np.cos(theta)
    return _rounded(np.stack([np.sin(theta), c * np.cos(phi), c * np.sin(phi)], 1))


def _choose(rng: np.random.Generator, n: int, edges: tuple, anywhere: Array) -> Array:
    return np.where(rng.random(n) < 0.5, rng.choice(np.array(edges), n), anywhere)


def _signs(rng: np.random.Generator, n: int) -> Array:
    return rng.choice([-1.0, 1.0], n)


def _rounded(x: Array) -> Array:
    return x.astype(np.float32).astype(np.float64)
