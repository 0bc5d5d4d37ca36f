"""How large a sample's weight may be: float64 look-ups in the tables that the kernels sample from.

A sample of lobe p at offset h has the weight A_p(h) / (2 q(p, h)), times what its direction adds.
With the tables, q is constant in a bin and mixed between two rows of theta, so the weight varies by
how much A_p does there; BIN_RATIO times the energy that the rows share out is the bar.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.device import layout
from furcl.fibre.attenuation import AttenuationTables
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

BIN_RATIO = 2.8
"""Largest value of A_p in a bin over what the tables promise for it: the worst for the paper's
bins, of TTs where the edge of the medulla lies in one (docs/model.md, Weights inside a bin)."""


ETAS = ((1.0, 1.01), (1.01, 1.2), (1.2, 3.0))
DEGREES = ((0.0, 80.0), (80.0, 89.0), (89.0, 90.0))
"""Ranges of the index and of |theta| for which the largest weights are told apart; their upper ends
belong to the next range, the last ones to the last."""


@dataclass
class Region:
    """Largest weights for one range of the index and of the inclination.

    `weight` as sampled, `ratio` over the energy of the tables, and `bin_ratio` the latter in
    float64 at all points.
    """

    eta: tuple[float, float]
    degrees: tuple[float, float]
    samples: int = 0
    weight: float = 0.0
    ratio: float = 0.0
    bin_ratio: float = 0.0

    def merge(self, other: Region) -> None:
        """Add what was found for the same ranges."""
        self.samples += other.samples
        for name in ("weight", "ratio", "bin_ratio"):
            setattr(self, name, max(getattr(self, name), getattr(other, name)))


def no_regions() -> list[Region]:
    """All regions, with nothing found in them."""
    return [Region(eta, degrees) for eta in ETAS for degrees in DEGREES]


def inside(region: Region, eta: float, cos: Array) -> NDArray[np.bool_]:
    """(n,) which inclinations of cosine `cos` are in a region, for a fibre of index `eta`."""
    degrees = np.degrees(np.arccos(np.minimum(cos, 1.0)))
    low, high = region.degrees
    of_eta = region.eta[0] <= eta and (eta < region.eta[1] or region.eta == ETAS[-1])
    below = (degrees < high) | (region.degrees == DEGREES[-1])
    return of_eta & (low <= degrees) & below


class Rows:
    """The two rows of the tables around inclinations of cosine `cos` (n,)."""

    def __init__(self, tables: AttenuationTables, cos: Array) -> None:
        last = layout.TABLE_ROWS - 1
        place = (1.0 - np.sqrt(cos)) * last
        self.node = np.minimum(place.astype(np.intp), last - 1)
        self.upper = place - self.node
        self._tables = tables

    @property
    def energy(self) -> Array:
        """(n,) what the chances are shares of, the larger of both rows."""
        energy = self._tables.energy
        return np.maximum(energy[self.node], energy[self.node + 1])

    def joint(self, h: Array) -> Array:
        """(lobes, n) densities q of lobe and offset at offsets h (n,), relative to uniform h."""
        bins = np.minimum((np.abs(h) * layout.TABLE_BINS).astype(np.intp), layout.TABLE_BINS - 1)
        joint = self._tables.joint.astype(np.float64)
        return (
            joint[self.node, :, bins].T * (1.0 - self.upper)
            + joint[self.node + 1, :, bins].T * self.upper
        )

    def weight(self, attenuation: Array, h: Array) -> Array:
        """(lobes, n) weights A_p / q of A_p (lobes, n) at offsets h (n,); 0 where A_p is."""
        q = self.joint(h)
        # The kernels choose no lobe of a smaller density (MIN_JOINT in fibre/sampler.clh).
        chosen = q >= 2e-30
        return np.divide(attenuation, q, out=np.zeros_like(q), where=chosen)


def largest_weight(probe: Probe, factors: Array, cos: Array, most_energy: float) -> Array:
    """(lobes, n): the bar for weights, mean of the channels, at inclinations of cosine `cos`.

    factors : (lobes,)      `Subject.direction_factors` of the probe
    most_energy : float     what all A_p add up to at most
    """
    tables = probe.material.tables
    # Without tables h is uniform and the weight the sum of all A_p, whose bar is the same.
    if tables is None:
        energy = np.full_like(cos, 1.001 * most_energy)
    else:
        energy = BIN_RATIO * Rows(tables, cos).energy
    return factors[:, None] * energy
