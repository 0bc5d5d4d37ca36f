"""Cells of (|h|, phi, s) for chi-square tests of samples of a fibre at one inclination."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

CELLS = (5, 6, 6)  # of |h|, phi, s
STEPS = (20, 12, 12)  # midpoints in each: one to a bin of the tables in |h|
N_CELLS = int(np.prod(CELLS))


def wo_at(theta: float) -> np.ndarray:
    """The known direction at an inclination, azimuth 0."""
    return np.array([np.sin(theta), np.cos(theta), 0.0])


def resolved(lobe: int) -> np.ndarray:
    """Which cells midpoints can integrate: the cone of R narrows to nothing towards phi = pi."""
    phi_cell = np.arange(N_CELLS) // CELLS[2] % CELLS[1]
    return (phi_cell > 0) & (phi_cell < CELLS[1] - 1) if lobe == 0 else phi_cell >= 0


def cell(h, phi, s) -> np.ndarray:
    """Cell indices of samples, folded by the symmetry of (h, phi) to h >= 0."""
    phi = np.where(h < 0, -phi, phi)
    parts = (
        np.abs(h) * CELLS[0],
        np.mod(phi + np.pi, 2 * np.pi) / (2 * np.pi) * CELLS[1],
        (s + 1) / 2 * CELLS[2],
    )
    index = [np.clip(p.astype(int), 0, n - 1) for p, n in zip(parts, CELLS, strict=True)]
    return np.asarray(np.ravel_multi_index(index, CELLS))


def integrals(densities: Callable[[np.ndarray, float], np.ndarray]) -> np.ndarray:
    """Integral of every lobe's density over every cell by midpoints, (lobes, cells).

    `densities(wi, h)` returns (lobes, n) for directions wi (n, 3) at one offset h >= 0, per unit of
    h in [-1, 1] and solid angle.
    """
    n_h, n_phi, n_s = (a * b for a, b in zip(CELLS, STEPS, strict=True))
    phi = -np.pi + (np.arange(n_phi) + 0.5) * (2 * np.pi / n_phi)
    s = -1 + (np.arange(n_s) + 0.5) * (2 / n_s)
    grid_phi, grid_s = (g.ravel() for g in np.meshgrid(phi, s, indexing="ij"))
    c = np.sqrt((1 - grid_s) * (1 + grid_s))
    wi = np.stack([grid_s, c * np.cos(grid_phi), c * np.sin(grid_phi)], 1)
    parts = []
    for offset in (np.arange(n_h) + 0.5) / n_h:
        at = cell(np.full(len(wi), offset), grid_phi, grid_s)
        rows = densities(wi, float(offset))
        parts.append([np.bincount(at, row, minlength=N_CELLS) for row in rows])
    # Both signs of h fold into one cell.
    return np.sum(parts, axis=0) * (2.0 / n_h) * (2 * np.pi / n_phi) * (2 / n_s)
