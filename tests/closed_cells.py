"""Chi-square tests of samples of a model whose scattering function knows no offset.

Cells are over u, in which the density along the fibre is nearly even whatever its width, and over
the azimuth, in steps that tell a caustic's pole to a per cent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from direction_statistics import chi_square_p
from offset_cells import wo_at
from scipy import stats

from furcl.rendering.probe import Probe

N_SAMPLES = 200_000
ALONG, NODES = 6, 5
AROUND, STEPS = 12, 40


@dataclass(frozen=True)
class Bell:
    """A lobe along the fibre by half the sum of the inclinations: "normal" or "cauchy"."""

    centre: float
    width: float
    kind: str

    def inclination(self, u: np.ndarray, theta: float) -> tuple[np.ndarray, np.ndarray]:
        """theta_o and |d theta_o / du| at u in (0, 1)."""
        if self.kind == "normal":
            x = stats.norm.ppf(u)
            slope = 1.0 / stats.norm.pdf(x)
        else:
            low, high = self._ends(theta)
            x = np.tan(low + u * (high - low))
            slope = (high - low) * (1.0 + x * x)
        return 2.0 * (self.centre + self.width * x) - theta, 2.0 * self.width * slope

    def u(self, theta_o: np.ndarray, theta: float) -> np.ndarray:
        """The inverse."""
        x = ((theta_o + theta) / 2.0 - self.centre) / self.width
        if self.kind == "normal":
            return stats.norm.cdf(x)
        low, high = self._ends(theta)
        return (np.arctan(x) - low) / (high - low)

    def _ends(self, theta: float) -> tuple[float, float]:
        low, high = (
            np.arctan((theta / 2.0 + end - self.centre) / self.width)
            for end in (-np.pi / 4, np.pi / 4)
        )
        return float(low), float(high)


def check_lobes(probe: Probe, bells: dict[str, Bell], theta: float, seed: int, level: float):
    """Of every lobe: cells of samples against Probe.pdf; where a lobe is a fifth of them, a density
    6 % too high must be seen."""
    n = N_SAMPLES
    wi, _, lobe, _, _ = probe.sample(wo_at(theta), n=n, seed=seed % 2**32)
    theta_o = np.arctan2(wi[:, 0], np.hypot(wi[:, 1], wi[:, 2])).astype(np.float64)
    phi = np.mod(np.arctan2(wi[:, 2], wi[:, 1]) + np.pi, 2.0 * np.pi)
    for p, name in enumerate(probe.lobes):
        bell = bells[name]
        expected = n * _expected(probe, p, bell, theta)
        row = np.clip((bell.u(theta_o, theta) * ALONG).astype(int), 0, ALONG - 1)
        column = np.clip((phi / (2.0 * np.pi) * AROUND).astype(int), 0, AROUND - 1)
        counts = np.bincount((row * AROUND + column)[lobe == p], minlength=ALONG * AROUND)
        # A row that a pole cuts is left to the rest, and what falls past it.
        ends = np.arange(ALONG)[:, None] / ALONG + np.array([1e-9, 1.0 / ALONG - 1e-9])
        whole = (np.abs(bell.inclination(ends, theta)[0]) < np.pi / 2).all(1).repeat(AROUND)
        counts, expected = counts[whole], expected[whole]
        if not whole.any() or expected.sum() < 500.0:
            continue
        assert _p(counts, expected) > level, (name, _p(counts, expected))
        if expected.sum() > 0.2 * n:
            assert _p(counts, 1.06 * expected) < level, f"a density 6 % too high: {name}"


def _p(counts: np.ndarray, expected: np.ndarray) -> float:
    rest = max(N_SAMPLES - expected.sum(), 1.0)
    return chi_square_p(np.append(counts, N_SAMPLES - counts.sum()), np.append(expected, rest))


def _expected(probe: Probe, lobe: int, bell: Bell, theta: float) -> np.ndarray:
    """Integral of Probe.pdf over each cell: Gauss-Legendre along, midpoints around."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    u = ((np.arange(ALONG)[:, None] + (x + 1.0) / 2.0) / ALONG).ravel()
    share = np.tile(w / 2.0 / ALONG, ALONG)
    theta_o, slope = bell.inclination(u, theta)
    there = np.abs(theta_o) < np.pi / 2
    phi = -np.pi + (np.arange(AROUND * STEPS) + 0.5) * (2.0 * np.pi / (AROUND * STEPS))
    angle, azimuth = (
        a.ravel() for a in np.meshgrid(np.where(there, theta_o, 0.0), phi, indexing="ij")
    )
    c = np.cos(angle)
    wi = np.stack([np.sin(angle), c * np.cos(azimuth), c * np.sin(azimuth)], 1)
    # The density is even over h, of width 2.
    pdf = 2.0 * probe.pdf(wo_at(theta), wi, 0.3, lobe=lobe).astype(np.float64)
    weight = np.where(there, share * slope * np.cos(theta_o), 0.0)
    values = pdf.reshape(len(u), -1) * weight[:, None] * (2.0 * np.pi / (AROUND * STEPS))
    return values.reshape(ALONG, NODES, AROUND, STEPS).sum((1, 3)).ravel()
