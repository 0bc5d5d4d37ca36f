"""Tables of the light that a medulla has scattered, as it leaves the whole fibre, for one material.

Source: docs/model.md, Simulated scattering. Energies are closed forms up to the first scattering;
the tables say what share of that light gets out, and where.

Proofs: tests/test_simulated.py holds them against walks that share nothing with them.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from furcl.cdf import inclusive_cdf
from furcl.device.choice import Device
from furcl.device.source import kernel_text
from furcl.fibre.double_cylinder.layout import (
    SIMULATED_BANDS,
    SIMULATED_OFFSETS,
    SIMULATED_PHIS,
    SIMULATED_SINES,
    SIMULATED_THETAS,
)
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import DEFAULT_SEED, cached
from furcl.fibre.double_cylinder.whole_fibre_walk import (
    BATCHES,
    COLLISION_BUDGET,
    ROWS,
    Tally,
    inner_sines,
    kernel_features,
    simulate,
    table_channels,
)

FORMAT_VERSION = 1

# Offsets over which the bands of light samples are averaged, and the least density of s in them
# over an even one: no light is where a sample is thought impossible.
BAND_OFFSETS = 128
LEAST_IN_BAND = 0.05


@dataclass(frozen=True, eq=False)
class SimulatedScattering:
    """All tables of one material.

    Rows: sin(theta_i) at 8 nodes even from 0 to 1, and |h'| / kappa = sin(j pi / 22), j = 0..11.
    Cells: 32 of phi_q over [-pi, pi) by 64 of s over [-1, 1]; phi_q = 0 goes back along the ray
    that enters the medulla, and phi = phi_q + gamma_t - gamma_i for h >= 0 (TTs).

    Attributes
    ----------
    density : (8, 12, 32, 64) float32       of what leaves, mean of the channels, over phi_q and s;
                                            integral 1
    phi_cdf : (8, 12, 32) float32           of phi_q, inclusive, last entry exactly 1
    sine_cdf : (8, 12, 32, 64) float32      of s given phi_q
    escape : (8, 12, channels) float32 or None      share of the scattered light that leaves; None
                                            without absorption, when it is 1
    colours : (8, 12, 32, 64, 3) float16 or None    what leaves of each channel over the mean;
                                            None where all channels are alike
    bands : (8, 16, 64) float32             density of s in bands of |phi|, of all h
    relative_error : float                  largest standard error of a row's escaping share,
                                            over it
    photons : int                           photons traced
    given_up : float                        share that outlived the limit on collisions
    """

    density: np.ndarray
    phi_cdf: np.ndarray
    sine_cdf: np.ndarray
    escape: np.ndarray | None
    colours: np.ndarray | None
    bands: np.ndarray
    relative_error: float
    photons: int
    given_up: float

    @property
    def channels(self) -> int:
        """Channels of absorption: 0, 1 or 3."""
        return 0 if self.escape is None else self.escape.shape[-1]

    def pack(self, channels: int | None = None) -> np.ndarray:
        """The float32 blocks that simulated.clh reads, one after the other.

        `channels` of absorption (default: those there are) may be more than the material needs.
        """
        channels = self.channels if channels is None else channels
        blocks = [self.phi_cdf.ravel(), self.sine_cdf.ravel()]
        if channels:
            escape = np.ones(1, np.float32) if self.escape is None else self.escape
            shape = (*self.phi_cdf.shape[:2], channels)
            blocks.append(np.broadcast_to(escape, shape).astype(np.float32).ravel())
        if channels == 3:
            colours = np.ones(1, np.float16) if self.colours is None else self.colours
            whole = np.ascontiguousarray(np.broadcast_to(colours, (*self.density.shape, 3)))
            blocks.append(whole.ravel().view(np.float32))
        return np.concatenate([*blocks, self.bands.ravel()])


def build_simulated(
    device: Device,
    fibre: Fibre,
    *,
    seed: int = DEFAULT_SEED,
    photons: int | None = None,
    cache: bool = True,
) -> SimulatedScattering | None:
    """Load the tables of a fibre, or simulate and store them.

    Parameters
    ----------
    device : Device
    fibre : Fibre
    seed : int              >= 0; the result is a function of fibre, seed, photons and device
    photons : int or None   photons for each of the 96 rows; None traces until a budget is spent
    cache : bool            read and write the cache folder (`furcl.paths.cache_folder`)

    Returns
    -------
    SimulatedScattering, or None if the fibre has no medulla that scatters
    """
    if not fibre.has_medulla:
        return None

    def made() -> dict[str, np.ndarray]:
        return _arrays(simulate(device, fibre, seed, photons))

    content = _content(device, fibre, seed, photons)
    return tables_of(fibre, cached(content, _shapes(fibre), made) if cache else made())


def _content(device: Device, fibre: Fibre, seed: int, photons: int | None) -> dict:
    """All that decides the tables."""
    names = ("eta", "kappa", "sigma_ca", "sigma_ms", "sigma_ma", "g", "layers")
    kernel = kernel_text("prepare/simulated.cl", kernel_features(fibre))
    return {
        **{name: getattr(fibre, name) for name in names},
        "seed": seed,
        "photons": photons,
        "budget": COLLISION_BUDGET,
        "batches": BATCHES,
        "simulated": FORMAT_VERSION,
        "device": (device.name, device.platform, device.driver_version),
        "kernel": hashlib.sha256(kernel.encode()).hexdigest(),
    }


def _shapes(fibre: Fibre) -> dict[str, tuple[int, ...]]:
    channels = max(table_channels(fibre), 1)
    return {
        "energy": (ROWS, channels, SIMULATED_PHIS, SIMULATED_SINES),
        "summary": (3,),
    }


def _arrays(tally: Tally) -> dict[str, np.ndarray]:
    """Tables as they are stored: what left in each cell of what entered, and its summary."""
    n = tally.photons * BATCHES
    of_batch = tally.energy.sum(axis=(2, 3, 4))
    mean = np.maximum(of_batch.mean(axis=1), np.finfo(np.float64).tiny)
    error = of_batch.std(axis=1, ddof=1) / np.sqrt(BATCHES) / mean
    return {
        "energy": (tally.energy.sum(axis=1) / n).astype(np.float32),
        "summary": np.array([error.max(), ROWS * n, tally.given_up]),
    }


def tables_of(fibre: Fibre, arrays: dict[str, np.ndarray]) -> SimulatedScattering:
    """The tables of energies in cells: `energy` (rows, channels, phis, sines) and `summary`."""
    rows = (SIMULATED_THETAS, SIMULATED_OFFSETS)
    energy = arrays["energy"].astype(np.float64)
    energy = np.moveaxis(energy.reshape(*rows, *energy.shape[1:]), 2, -1)
    mean = energy.mean(axis=-1)
    total = mean.sum(axis=(2, 3), keepdims=True)
    even = 1.0 / mean[0, 0].size
    share = np.divide(mean, total, out=np.full_like(mean, even), where=total > 0.0)
    of_phi = share.sum(axis=3)
    given = np.divide(
        share, of_phi[..., None], out=np.full_like(share, 1.0 / SIMULATED_SINES),
        where=of_phi[..., None] > 0.0,
    )  # fmt: skip
    phi_cdf, sine_cdf = inclusive_cdf(of_phi), inclusive_cdf(given)
    # What kernels read are differences of the float32 sums: so is all else made of them.
    chance = np.diff(phi_cdf, prepend=np.float32(0.0), axis=-1)[..., None] * np.diff(
        sine_cdf, prepend=np.float32(0.0), axis=-1
    )
    escape, colours = None, None
    channels = table_channels(fibre)
    if channels == 1:
        escape = total.reshape(*rows, 1).astype(np.float32)
    if channels == 3:
        ratio = np.divide(
            energy, mean[..., None], out=np.ones_like(energy), where=mean[..., None] > 0.0
        )
        colours = ratio.astype(np.float16)
        of_channel = (chance[..., None] * colours.astype(np.float64)).sum(axis=(2, 3))
        escape = (total[..., 0] * of_channel).astype(np.float32)
    cell = 2.0 * np.pi / SIMULATED_PHIS * 2.0 / SIMULATED_SINES
    worst, photons, given_up = arrays["summary"]
    return SimulatedScattering(
        (chance / cell).astype(np.float32),
        phi_cdf,
        sine_cdf,
        escape,
        colours,
        _bands(fibre, mean),
        float(worst),
        int(photons),
        float(given_up),
    )


def _bands(fibre: Fibre, energy: np.ndarray) -> np.ndarray:
    """Density of s in bands of |phi| for each theta, of TTs and all h.

    Parameters
    ----------
    energy : (thetas, offsets, phis, sines)     that leaves in each cell
    """
    bands = np.zeros((SIMULATED_THETAS, SIMULATED_BANDS, SIMULATED_SINES))
    part = (np.arange(BAND_OFFSETS) + 0.5) / BAND_OFFSETS
    phi_q = (np.arange(4 * SIMULATED_PHIS) + 0.5) / (4 * SIMULATED_PHIS) * 2.0 * np.pi - np.pi
    for i, sine in enumerate(inner_sines(fibre)):
        cos_t = np.sqrt((1.0 - sine) * (1.0 + sine))
        cos_i = np.sqrt(max(1.0 - (fibre.eta * sine) ** 2, 1e-6))
        h = part * min(1.0, fibre.kappa * fibre.eta * cos_t / cos_i)
        inner = h * cos_i / (fibre.eta * cos_t)
        chord = np.sqrt(np.maximum(fibre.kappa**2 - inner**2, 0.0))
        weight = -np.expm1(-2.0 * chord * fibre.sigma_ms / cos_t)
        place = np.arcsin(np.minimum(inner / fibre.kappa, 1.0)) * (SIMULATED_OFFSETS - 1)
        nearest = np.rint(place / (0.5 * np.pi)).astype(int)
        phi = phi_q + (np.arcsin(inner) - np.arcsin(h))[:, None]
        away = np.abs(phi - 2.0 * np.pi * np.rint(phi / (2.0 * np.pi)))
        band = np.minimum((away / np.pi * SIMULATED_BANDS).astype(int), SIMULATED_BANDS - 1)
        light = weight[:, None, None] * energy[i, nearest].repeat(4, axis=1)
        np.add.at(bands[i], band, light)
    total = bands.sum(axis=2, keepdims=True)
    share = np.divide(
        bands, total, out=np.full_like(bands, 1.0 / SIMULATED_SINES), where=total > 0.0
    )
    density = (1.0 - LEAST_IN_BAND) * share * (SIMULATED_SINES / 2.0) + 0.5 * LEAST_IN_BAND
    return density.astype(np.float32)
