"""Chi-square tests of samplers of directions against their densities."""

from __future__ import annotations

import numpy as np
from scipy import stats

ALPHA = 0.01


def sidak(family: int, alpha: float = ALPHA) -> float:
    """Level of one of `family` tests that together reject a truth with probability alpha."""
    return 1.0 - (1.0 - alpha) ** (1.0 / family)


def directions(theta, phi):
    """Unit vectors (n, 3) of polar angles and azimuths [rad]."""
    return np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1
    )


class SphereBins:
    """Cells between equally spaced polar angles and azimuths, azimuths beginning at `shift`."""

    def __init__(self, n_theta: int, n_phi: int, shift: float = 0.0):
        self.n_theta, self.n_phi, self.shift = n_theta, n_phi, shift

    def counts(self, dirs):
        """How many of the directions fall into each cell."""
        theta = np.arctan2(np.hypot(dirs[:, 0], dirs[:, 1]), dirs[:, 2])
        phi = np.mod(np.arctan2(dirs[:, 1], dirs[:, 0]) - self.shift, 2.0 * np.pi)
        row = np.minimum((theta / np.pi * self.n_theta).astype(int), self.n_theta - 1)
        column = np.minimum((phi / (2.0 * np.pi) * self.n_phi).astype(int), self.n_phi - 1)
        return np.bincount(row * self.n_phi + column, minlength=self.n_theta * self.n_phi)

    def integrals(self, density, steps: int):
        """Integral over each cell of a density per solid angle, midpoint rule of steps x steps."""
        edges = np.linspace(0.0, np.pi, self.n_theta * steps + 1)
        theta = 0.5 * (edges[1:] + edges[:-1])
        band = np.cos(edges[:-1]) - np.cos(edges[1:])
        n_phi = self.n_phi * steps
        phi = self.shift + (np.arange(n_phi) + 0.5) * (2.0 * np.pi / n_phi)
        grid = np.meshgrid(theta, phi, indexing="ij")
        values = density(directions(grid[0].ravel(), grid[1].ravel())).reshape(len(theta), n_phi)
        values = values * band[:, None] * (2.0 * np.pi / n_phi)
        return values.reshape(self.n_theta, steps, self.n_phi, steps).sum(axis=(1, 3)).ravel()


def chi_square_p(counts, expected, least: float = 5.0) -> float:
    """p-value of counts against expected counts; cells with fewer than `least` are pooled."""
    order = np.argsort(expected)
    counts, expected = counts[order].astype(float), expected[order]
    pooled = np.searchsorted(expected, least, side="left")
    if pooled:
        n = min(pooled + 1, len(expected))
        counts = np.append(counts[n:], counts[:n].sum())
        expected = np.append(expected[n:], expected[:n].sum())
    statistic = float(np.sum((counts - expected) ** 2 / expected))
    return float(stats.chi2.sf(statistic, len(counts) - 1))
