"""Analog random walks in a cylinder in float64: photons that are counted when they leave."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True)
def leave(
    tau: float, g: float, h: float, theta: float, n: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Send `n` photons into a cylinder of radius 1 from azimuth 0 and follow them out of it.

    h outside [-1, 1] draws it evenly. Textbook inversion of Henyey-Greenstein.

    Returns
    -------
    phi, s, length : (n,) float     azimuth and sine of the direction of exit, path length
    collisions : (n,) int
    """
    phi, s, length = np.empty(n), np.empty(n), np.empty(n)
    collisions = np.zeros(n, np.int64)
    for i in range(n):
        y = -h if abs(h) <= 1.0 else 1.0 - 2.0 * rng.random()
        x = math.sqrt(max(0.0, 1.0 - y * y))
        u, v, w = -math.cos(theta), 0.0, -math.sin(theta)
        flown = 0.0
        while True:
            flight = -math.log(1.0 - rng.random()) / tau
            new_x, new_y = x + flight * u, y + flight * v
            if new_x * new_x + new_y * new_y > 1.0:
                break
            x, y = new_x, new_y
            flown += flight
            collisions[i] += 1
            xi = rng.random()
            if abs(g) < 1e-6:
                cosine = 2.0 * xi - 1.0
            else:
                ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * xi)
                cosine = min(1.0, max(-1.0, (1.0 + g * g - ratio * ratio) / (2.0 * g)))
            sine = math.sqrt(1.0 - cosine * cosine)
            angle = 2.0 * math.pi * rng.random()
            a, b = sine * math.cos(angle), sine * math.sin(angle)
            across = math.sqrt(u * u + v * v)
            if across < 1e-9:
                u, v, w = a, b, math.copysign(cosine, w * cosine)
            else:
                u, v, w = (
                    cosine * u + (a * u * w - b * v) / across,
                    cosine * v + (a * v * w + b * u) / across,
                    cosine * w - a * across,
                )
        a, b = u * u + v * v, x * u + y * v
        inside = max(0.0, 1.0 - x * x - y * y)
        flown += (math.sqrt(b * b + a * inside) - b) / a
        phi[i], s[i], length[i] = math.atan2(v, u), w, flown
    return phi, s, length, collisions
