"""The double cylinder under the stability sweep.

A fibre is one of the grid (two ordinary fibres with one parameter moved to each of its edges) or a
random one, every parameter at an edge or anywhere in its range with equal chance.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_conditioning import rescaled
from furcl.bench.stability_subject import Subject
from furcl.cdf import inclusive_cdf
from furcl.fibre.double_cylinder import layout
from furcl.fibre.double_cylinder.features import DoubleCylinderFeatures
from furcl.fibre.double_cylinder.model import MODEL
from furcl.fibre.double_cylinder.parameters import RANGES, Fibre
from furcl.fibre.double_cylinder.profiles import (
    AzimuthProfiles,
    LongitudinalProfiles,
    MedullaProfiles,
)
from furcl.fibre.double_cylinder.simulated import SimulatedScattering, tables_of
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

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


class DoubleCylinderSubject(Subject):
    """Fibres of the double cylinder, with profiles of no particular medulla."""

    def __init__(self) -> None:
        super().__init__(MODEL, Fibre)

    def grid(self) -> Iterator[tuple[str, Any, Fibre]]:
        return grid_fibres()

    def random(self, rng: np.random.Generator) -> Fibre:
        return random_fibre(rng)

    def edge(self, fibre: Fibre, cos: Array) -> Array:
        """Where rays begin to miss the medulla, whose chord begins as a square root."""
        n_t = np.sqrt((fibre.eta - 1.0) * (fibre.eta + 1.0) + cos**2)
        return fibre.kappa * n_t / np.maximum(cos, 1e-30)

    def neighbours(self, fibre: Fibre, way: float) -> list[Fibre]:
        """Where the chord begins, h' against kappa: either moves with the other kept."""
        return [fibre.replace(kappa=float(rescaled(np.array(fibre.kappa), way)))]

    def prepared(self, features: DoubleCylinderFeatures) -> MedullaProfiles | SimulatedScattering:
        if features.simulated:
            return random_simulated(features.profile_channels)
        return random_profiles(features.profile_channels)

    def direction_factors(self, probe: Probe) -> Array:
        factors = np.ones(len(probe.lobes))
        factors[3 : 6 if probe.fibre.is_simulated else 5] = self.scattered_factor(probe)
        return factors

    def scattered_factor(self, probe: Probe) -> float:
        """That of lobes that the medulla scatters."""
        if probe.material.profiles is None:
            return 1.0
        if isinstance(probe.material.profiles, SimulatedScattering):
            return _simulated_factor(probe.material.profiles, probe.sampler)
        return _direction_factor(probe.material.profiles, probe.sampler)

    def index(self, fibre: Fibre) -> float:
        return fibre.eta


class SimulatedSubject(DoubleCylinderSubject):
    """The same fibres with simulated scattering, with tables of no particular fibre."""

    def grid(self) -> Iterator[tuple[str, Any, Fibre]]:
        for name, value, fibre in grid_fibres():
            yield name, value, fibre.replace(scattering="simulated")

    def random(self, rng: np.random.Generator) -> Fibre:
        return random_fibre(rng).replace(scattering="simulated")


SUBJECT = DoubleCylinderSubject()
SIMULATED_SUBJECT = SimulatedSubject()


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


@functools.cache
def random_profiles(channels: int, seed: int = 1) -> MedullaProfiles:
    """Profiles of no particular medulla: both sides read the same tables, so any will do to compare
    the arithmetic around them. Densities differ by a thousand from bin to bin. `channels` of
    absorption is 0, 1 or 3."""
    rng = np.random.default_rng(seed)

    def shares(*shape: int) -> Array:
        raw = np.exp(rng.uniform(-7.0, 0.0, shape))
        return raw / raw.sum(-1, keepdims=True)

    phi = shares(layout.PROFILE_TAUS, layout.PROFILE_OFFSETS, layout.PROFILE_PHIS)
    sine = shares(layout.PROFILE_THETAS, 2, layout.PROFILE_SINES)
    absorption = rng.uniform(0.0, 1.0, (*phi.shape, max(channels, 1))).astype(np.float32)
    # The kernels read the differences of the float32 CDF.
    cdf = inclusive_cdf(phi)
    chance = np.diff(cdf, prepend=np.float32(0.0))
    escape = (chance[..., None] * absorption).sum(2).astype(np.float32)
    density = chance * np.float32(layout.PROFILE_PHIS / (2.0 * np.pi))
    along = (sine * layout.PROFILE_SINES / 2.0).astype(np.float32)
    return MedullaProfiles(
        AzimuthProfiles(density, cdf, absorption if channels else None, np.zeros_like(density)),
        LongitudinalProfiles(along, inclusive_cdf(sine), np.zeros_like(along)),
        escape if channels else None,
        0.0,
        0,
        0.0,
    )


@functools.cache
def random_simulated(channels: int, seed: int = 1) -> SimulatedScattering:
    """Tables of no particular fibre, as `random_profiles`."""
    rng = np.random.default_rng(seed)
    rows = layout.SIMULATED_THETAS * layout.SIMULATED_OFFSETS
    shape = (rows, max(channels, 1), layout.SIMULATED_PHIS, layout.SIMULATED_SINES)
    energy = np.exp(rng.uniform(-7.0, 0.0, shape))
    energy *= rng.uniform(0.1, 1.0, (rows, 1, 1, 1)) / energy.sum(axis=(2, 3), keepdims=True)
    absorbs = {0: 0.0, 1: 0.5, 3: (0.1, 0.5, 1.0)}[channels]
    fibre = Fibre(kappa=0.6, sigma_ms=1.0, sigma_ca=absorbs, scattering="simulated")
    return tables_of(fibre, {"energy": energy.astype(np.float32), "summary": np.zeros(3)})


def _simulated_factor(tables: SimulatedScattering, sampler) -> float:
    """As `_direction_factor`."""
    factor = 1.0
    if tables.colours is not None and tables.escape is not None:
        mean = tables.escape.mean(axis=-1, keepdims=True)
        factor = float(tables.colours.max() * (mean / tables.escape).max())
    if sampler.scattered_angles == "uniform":
        factor *= float(4.0 * np.pi * tables.density.max())
    return factor


def _direction_factor(profiles: MedullaProfiles, sampler) -> float:
    """Value over density of a scattered lobe's directions, over its energy, at most: what is not
    absorbed on the way to one azimuth over what is not on the way to all, and for directions that
    are drawn uniformly how much denser the profiles are than that."""
    absorption, escape = profiles.azimuth.absorption, profiles.escape
    factor = 1.0
    if absorption is not None and escape is not None:
        factor = float(absorption.max() / escape.min())
    if sampler.scattered_angles == "uniform":
        peak = profiles.azimuth.density.max() * profiles.longitudinal.density.max()
        factor *= float(4.0 * np.pi * peak)
    return factor
