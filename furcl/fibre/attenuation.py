"""Attenuation tables: lobe and offset h by CDFs over theta.

Source: Shibaike and Iwasaki, sections 4.2 and 4.4 (200 bins over h in [-1, 1]). Changed: rows over
theta, because A_p depends on it, dense at grazing incidence, where it depends on it most (with rows
even in theta a thin cuticle seen along the fibre gives weights of 10^6); 100 bins over |h|, A_p
being even in h; bins that hold a narrow peak are lifted, see PEAK_TO_MEAN.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from furcl.cdf import inclusive_cdf
from furcl.device.layout import ABSORPTION_NODES

# A bin in which the quadrature sees nothing still gets this share of its lobe's mean, so that q is
# positive wherever the lobe can be.
FLOOR = 1e-3 / 200

# A bin is chosen at least as often as if its mean were its peak over this number: no weight is
# larger than that times the energy which the row's chances are shares of.
PEAK_TO_MEAN = 1.7

# Every bin of a lobe that exists has at least this share of the row's energy, were it the only bin:
# peaks too narrow for the quadrature to see.
SMALLEST_SHARE = 1e-4

# Rows at which peaks are sought, for each row of the tables, and more of them, two
# for each halving of the cosine, where thin cuticles begin to reflect everything.
ROWS_BETWEEN = 4
GRAZING_ROWS = 16


def row_angles(rows: int) -> np.ndarray:
    """|theta| (rows,) [rad] of the rows, from 0 to pi/2, even in sqrt(cos(theta))."""
    cosine = (1.0 - np.arange(rows) / (rows - 1)) ** 2
    return np.arccos(cosine)


def node_absorptions(absorbs: tuple[float, float]) -> np.ndarray:
    """The absorptions (ABSORPTION_NODES,) that there are tables for where it differs, even in their
    square root from the smallest to the largest of any hit."""
    low, high = np.sqrt(absorbs)
    return np.linspace(low, high, ABSORPTION_NODES) ** 2


def node_scale(absorbs: tuple[float, float]) -> np.ndarray:
    """The square root of the smallest, and nodes per unit of it, (2,) float32: by them
    kernels/include/fibre/rows.clh finds nodes."""
    low, high = np.sqrt(absorbs)
    return np.array([low, (ABSORPTION_NODES - 1) / (high - low)], np.float32)


@dataclass(frozen=True, eq=False)
class AttenuationTables:
    """CDFs and densities of (lobe, h) for every row of theta.

    Attributes
    ----------
    lobe_cdf : (rows, lobes) float32            inclusive; zeros where no lobe carries light
    bin_cdf : (rows, lobes, bins) float32       over |h|, inclusive, last entry 1
    joint : (rows, lobes, bins) float32         q(lobe, h), relative to h uniform over [-1, 1]: its
                                                mean over h, summed over lobes, is 1
    lobe_probability : (rows, lobes) float64    P(lobe), for statistics
    energy : (rows,) float64                    what the chances are shares of: the albedo, and what
                                                is lifted; times PEAK_TO_MEAN the largest weight
    """

    lobe_cdf: np.ndarray
    bin_cdf: np.ndarray
    joint: np.ndarray
    lobe_probability: np.ndarray
    energy: np.ndarray

    @property
    def packed(self) -> np.ndarray:
        """The float32 blocks that kernels/include/fibre/sampler.clh reads."""
        blocks = (self.lobe_cdf, self.bin_cdf, self.joint)
        return np.concatenate([block.ravel() for block in blocks]).astype(np.float32)


def peak_angles(rows: int) -> np.ndarray:
    """|theta| [rad] at which peaks are sought: ROWS_BETWEEN for each of the rows, the last at pi/2,
    then GRAZING_ROWS between the last two of these."""
    theta = row_angles(1 + (rows - 1) * ROWS_BETWEEN)
    cosine = ((1.0 / ((rows - 1) * ROWS_BETWEEN)) ** 2) * 0.5 ** (
        0.5 * np.arange(1, GRAZING_ROWS + 1)
    )
    return np.concatenate([theta, np.arccos(cosine)])


def peaks_around(peaks: np.ndarray) -> np.ndarray:
    """Largest value between the rows before and after each row of the tables.

    Parameters
    ----------
    peaks : (len(peak_angles(rows)), lobes, bins)     peak of A_p in each bin

    Returns
    -------
    (rows, lobes, bins)
    """
    n = ROWS_BETWEEN
    even = peaks[:-GRAZING_ROWS].copy()
    even[-1] = np.maximum(even[-1], peaks[-GRAZING_ROWS:].max(axis=0))
    padded = np.pad(even, ((n, n), (0, 0), (0, 0)))
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * n + 1, axis=0)
    return around[::n].max(axis=-1)


def tables_from_bins(bins: np.ndarray, peaks: np.ndarray | None = None) -> AttenuationTables:
    """Turn bin means of the attenuation into CDFs.

    Parameters
    ----------
    bins : (rows, lobes, bins) float    mean of A_p over each bin of |h|, >= 0
    peaks : (rows, lobes, bins) float   what `peaks_around` returns; without them no bin is lifted

    Returns
    -------
    AttenuationTables
    """
    means = np.asarray(bins, np.float64)
    lobe_means = means.mean(axis=2, keepdims=True)
    means = np.where(lobe_means > 0.0, np.maximum(means, FLOOR * lobe_means), 0.0)
    if peaks is not None:
        means = np.maximum(means, np.asarray(peaks, np.float64) / PEAK_TO_MEAN)
        exists = means.max(axis=(0, 2), keepdims=True) > 0.0
        smallest = SMALLEST_SHARE * means.mean(axis=2).sum(axis=1)[:, None, None]
        means = np.where(exists, np.maximum(means, smallest), 0.0)
    n_bins = means.shape[2]
    energy = means.mean(axis=2)
    total = energy.sum(axis=1, keepdims=True)
    alive = total > 0.0
    probability = np.divide(energy, total, out=np.zeros_like(energy), where=alive)
    lobe_cdf = inclusive_cdf(probability)
    sums = means.sum(axis=2, keepdims=True)
    bin_cdf = inclusive_cdf(
        np.divide(means, sums, out=np.full_like(means, 1 / n_bins), where=sums > 0)
    )
    joint = np.divide(means, total[..., None], out=np.zeros_like(means), where=alive[..., None])
    return AttenuationTables(
        lobe_cdf=np.where(alive, lobe_cdf, 0.0).astype(np.float32),
        bin_cdf=bin_cdf.astype(np.float32),
        joint=joint.astype(np.float32),
        lobe_probability=probability,
        energy=total[:, 0],
    )
