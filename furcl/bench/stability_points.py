"""Where `furcl bench stability` looks: fibres and points at the ends of their ranges.

A fibre is one of the grid (two ordinary fibres with one parameter moved to each of its edges) or a
random one, every parameter at an edge or anywhere in its range with equal chance. Points mix the
edges of inclination, offset and direction in the same way. Values are rounded to what float32 can
hold, so that the device and the reference are given the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.double_cylinder.parameters import RANGES, Fibre

Array = NDArray[np.float64]

LAST = 1.0 - 2.0**-24
"""Largest number below 1 that float32 can hold."""

_BETAS = tuple(math.degrees(b) for b in (1e-3, 3e-3, 0.03, 0.25, 0.41, 1.0, 1.51, 2.5))
EDGES: dict[str, tuple] = {
    "eta": (1.0001, 1.001, 1.05, 1.33, 1.55, 3.0),
    "kappa": (0.0, 1e-6, 1e-3, 0.5, 0.999, 1.0 - 1e-6, 1.0),
    "alpha_deg": (-20.0, -3.0, 0.0, 1e-4, 20.0),
    "beta_m_deg": _BETAS,
    "beta_n_deg": _BETAS,
    "sigma_ca": (0.0, 1e-8, 1.0, 50.0, 1e4, (1e-2, 1.0, 1e4)),
    "sigma_ms": (0.0, 1e-8, 1e-3, 1.0, 50.0, 1e4),
    "sigma_ma": (0.0, 1e-8, 1.0, 50.0, 1e4, (1e-2, 1.0, 1e4)),
    "g": (-0.99, -1e-4, 0.0, 1e-4, 0.99),
    "layers": (0.0, 1e-3, 0.5, 1.0, 10.0),
}
"""Values of every parameter that lie at the end of its range or where a formula changes."""

_BASES = (
    {"eta": 1.5, "kappa": 0.7, "beta_m_deg": 12.0, "beta_n_deg": 15.0, "sigma_ca": (0.1, 0.3, 0.9),
     "sigma_ms": 2.0, "sigma_ma": (0.01, 0.2, 1.0), "g": 0.4, "layers": 1.3},
    {"sigma_ca": 0.2},
)  # fmt: skip

# Log-uniform from here to the upper end of the range; the others are uniform.
_LOGARITHMIC = {"beta_m_deg": _BETAS[0], "beta_n_deg": _BETAS[0], "sigma_ca": 1e-8,
                "sigma_ms": 1e-8, "sigma_ma": 1e-8}  # fmt: skip

THETAS = tuple(
    math.radians(t) for t in (0, 1e-7, 30, 60, 80, 89, 89.9, 90 - 1e-3, 90 - 1e-5, 90 - 1e-7, 90)
)
OFFSETS = (0.0, 1e-7, 1e-3, 0.5, 0.99, 1 - 1e-6, LAST, 1.0)


def grid_fibres() -> Iterator[tuple[str, float | tuple, Fibre]]:
    """Two ordinary fibres with one parameter at an edge: its name, its value, the fibre."""
    for base in _BASES:
        for name, values in EDGES.items():
            for value in values:
                yield name, value, Fibre(**{**base, name: value})


def random_fibre(rng: np.random.Generator) -> Fibre:
    """Every parameter at an edge or anywhere, with equal chance."""

    def anywhere(name: str) -> float:
        low, high = RANGES[name]
        if name in _LOGARITHMIC:
            return float(np.exp(rng.uniform(np.log(_LOGARITHMIC[name]), np.log(high))))
        return float(rng.uniform(low, high))

    values = {}
    for name, edges in EDGES.items():
        if rng.random() < 0.5:
            values[name] = edges[rng.integers(len(edges))]
        elif name in ("sigma_ca", "sigma_ma"):
            values[name] = tuple(anywhere(name) for _ in range(3))
        else:
            values[name] = min(max(anywhere(name), RANGES[name][0]), RANGES[name][1])
    return Fibre(**values)


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


def points(fibre: Fibre, rng: np.random.Generator, n: int) -> Points:
    """Random points, half of each coordinate at an edge."""
    theta = _choose(rng, n, THETAS, rng.uniform(0.0, np.pi / 2, n)) * _signs(rng, n)
    sin_cos = _rounded(np.stack([np.sin(theta), np.cos(theta)], 1))
    h = _choose(rng, n, OFFSETS, rng.uniform(0.0, 1.0, n))
    # A quarter of the offsets graze the medulla, where its chord begins as a square root.
    n_t = np.sqrt((fibre.eta - 1.0) * (fibre.eta + 1.0) + sin_cos[:, 1] ** 2)
    cos = np.maximum(sin_cos[:, 1], 1e-30)
    graze = fibre.kappa * n_t / cos * (1.0 + rng.choice([0, 1e-7, -1e-7, 1e-4, -1e-4], n))
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
