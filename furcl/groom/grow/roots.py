"""Where strands begin: stratified samples of a surface, thinned by a density."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

# The generalised golden ratio of two dimensions, root of x^3 = x + 1; its powers give the
# additive sequence of lowest known discrepancy (Roberts 2018, "R2").
_PLASTIC = 1.32471795724474602596

Rng = np.random.Generator
Vectors = NDArray[np.float64]


def stratified_square(n: int, rng: Rng) -> Vectors:
    """(n, 2) evenly spread points of the unit square, without a visible pattern.

    The R2 sequence, shifted at random and jittered within the cell that a point owns.
    """
    steps = np.array([1.0 / _PLASTIC, 1.0 / _PLASTIC**2])
    index = np.arange(n, dtype=np.float64)[:, None]
    jitter = (rng.random((n, 2), dtype=np.float32) - 0.5) / np.sqrt(n)
    return (index * steps + rng.random(2) + jitter) % 1.0


def unit_directions(square: Vectors) -> Vectors:
    """Map points of the unit square to the unit sphere (n, 3), keeping areas."""
    z = 1.0 - 2.0 * square[:, 0]
    phi = 2.0 * np.pi * square[:, 1]
    r = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)


def thinned(n: int, density: Callable[[Vectors], Vectors], rng: Rng) -> Vectors:
    """Exactly n points (n, 2) of the unit square, distributed as `density` (0 .. 1) says.

    More candidates than needed are drawn, and the n with the smallest u / density are kept,
    u being uniform: every candidate is kept with a probability proportional to its density.

    `density` maps points (m, 2) to values (m,) in 0 .. 1 that are not 0 everywhere.
    """
    pilot = float(density(stratified_square(8192, rng)).mean())
    candidates = stratified_square(int(1.3 * n / max(pilot, 1e-4)) + 64, rng)
    weight = np.maximum(density(candidates), 1e-12)
    order = rng.random(len(candidates), dtype=np.float32) / weight
    kept = np.argpartition(order, n - 1)[:n]
    return candidates[np.sort(kept)]


def noise_map(points: Vectors, scale: float, rng: Rng) -> Vectors:
    """A smooth random field at points (n, 3): mean 0, variance 1, about `scale` waves a unit.

    A sum of 24 plane waves of random direction, phase and length (0.6 .. 1.4 times the mean).
    """
    n_waves = 24
    directions = unit_directions(stratified_square(n_waves, rng))
    wave = 2.0 * np.pi * scale * rng.uniform(0.6, 1.4, n_waves)[:, None] * directions
    phase = rng.uniform(0.0, 2.0 * np.pi, n_waves)
    value = np.zeros(len(points), dtype=np.float32)
    for vector, start in zip(wave, phase, strict=True):
        value += np.cos((points @ vector + start).astype(np.float32))
    return value * np.sqrt(2.0 / n_waves)
