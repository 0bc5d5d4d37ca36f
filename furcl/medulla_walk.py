"""Launches the random walks behind the medulla profiles and adds their counts up.

The walks are in kernels/medulla.cl. Source: SPEC 2.6; expected-value (last-flight) estimators are
classic (Spanier and Gelbard 1969). Photons are added row by row until the table is good enough.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from furcl import program
from furcl.buffers import Memory
from furcl.device import Device
from furcl.features import Features
from furcl.fibre import Fibre
from furcl.layout import (
    PROFILE_OFFSETS,
    PROFILE_PHIS,
    PROFILE_SINES,
    PROFILE_TAUS,
    PROFILE_THETAS,
)

log = logging.getLogger(__name__)

AZIMUTH_ROWS = PROFILE_TAUS * PROFILE_OFFSETS
BATCHES = 64
"""Independent batches of each row; their spread gives the standard errors."""

OPTICAL_RADIUS_CAP = 40.0
"""Largest (1 - g) tau that is walked; denser media are replaced by this one, see `plan_rows`."""

TARGET_ERROR = 0.0175
"""Photons are added to a row until its relative standard error is below this."""

FIRST_PHOTONS = 24
COLLISION_BUDGET = 60e6
MAX_ROUNDS = 8
GROWTH = 5.0


@dataclass(frozen=True)
class RowPlan:
    """What enters the cylinder in each of the 128 azimuthal and 16 longitudinal rows.

    Attributes
    ----------
    rows : (144, 10) float32    tau, absorption (3), cos and sin of theta_i, h, sqrt(1 - h^2),
                                kind, photons a batch; all per medulla radius
    max_collisions : int        after which a photon is given up
    capped : bool               some row is denser than OPTICAL_RADIUS_CAP
    """

    rows: np.ndarray
    max_collisions: int
    capped: bool


@dataclass
class Tally:
    """Sums of the walks.

    Attributes
    ----------
    sums : (144, BATCHES, 1 + channels, 128) float64    scores; then scores times absorption
    photons : (144,) int        photons of each batch of a row
    collisions : float          of all photons
    given_up : float            largest share of a row's weight that max_collisions cut off
    """

    sums: np.ndarray
    photons: np.ndarray
    collisions: float = 0.0
    given_up: float = 0.0


def absorption_channels(fibre: Fibre) -> int:
    """Channels of medulla absorption: 0 without any, 1 if grey, else 3."""
    if not any(fibre.sigma_ma):
        return 0
    return 1 if len(set(fibre.sigma_ma)) == 1 else 3


def tau_nodes(fibre: Fibre) -> np.ndarray:
    """(PROFILE_TAUS,) cos(theta_t) of the azimuthal tables, from 1 down to sqrt(1 - 1/eta^2)."""
    cos_min = math.sqrt((fibre.eta - 1.0) * (fibre.eta + 1.0)) / fibre.eta
    return np.linspace(1.0, cos_min, PROFILE_TAUS)


def plan_rows(fibre: Fibre) -> RowPlan:
    """Describe every row.

    A medulla with (1 - g) tau > OPTICAL_RADIUS_CAP is walked with tau reduced to that and its
    absorption in proportion, which keeps albedo and phase function: what is re-emitted from the
    skin of a dense medium depends on these alone.
    """
    rows = np.zeros((AZIMUTH_ROWS + PROFILE_THETAS, 10))
    azimuth, longitudinal = rows[:AZIMUTH_ROWS], rows[AZIMUTH_ROWS:]
    angle = np.linspace(0.0, 0.5 * np.pi, PROFILE_OFFSETS)
    azimuth[:, 0] = np.repeat(fibre.kappa / tau_nodes(fibre), PROFILE_OFFSETS)
    azimuth[:, 4] = 1.0
    azimuth[:, 6] = np.tile(np.sin(angle), PROFILE_TAUS)
    azimuth[:, 7] = np.tile(np.maximum(np.cos(angle), 0.0), PROFILE_TAUS)
    azimuth[PROFILE_OFFSETS - 1 :: PROFILE_OFFSETS, 7] = 0.0
    theta = np.linspace(0.0, 0.5 * np.pi, PROFILE_THETAS)
    longitudinal[:, 0] = fibre.kappa
    longitudinal[:, 4] = np.maximum(np.cos(theta), 1e-6)
    longitudinal[:, 5] = np.sin(theta)
    longitudinal[:, 8] = 1.0
    rows[:, 1:4] = rows[:, :1] * np.asarray(fibre.sigma_ma)
    rows[:, 0] *= fibre.sigma_ms
    cap = OPTICAL_RADIUS_CAP / (1.0 - fibre.g)
    shrink = np.minimum(1.0, cap / rows[:, :1])
    rows[:, :4] *= shrink
    # Slowest mode of diffusion in a cylinder: exp(-n (1 - g) 5.78 / (3 radius^2)) after n
    # collisions; this many leave less than 1e-9 of it.
    radius = min(OPTICAL_RADIUS_CAP, float(rows[:, 0].max()) * (1.0 - fibre.g))
    max_collisions = math.ceil((64.0 + 12.0 * radius**2) / (1.0 - abs(fibre.g)))
    return RowPlan(rows.astype(np.float32), max_collisions, bool((shrink < 1.0).any()))


def bin_centres() -> np.ndarray:
    """(3, 128) float32: cos and sin of the middles of the phi bins; s of those of the s bins."""
    phi = -np.pi + (np.arange(PROFILE_PHIS) + 0.5) * (2.0 * np.pi / PROFILE_PHIS)
    s = -1.0 + (np.arange(PROFILE_SINES) + 0.5) * (2.0 / PROFILE_SINES)
    return np.stack([np.cos(phi), np.sin(phi), np.tile(s, 2)]).astype(np.float32)


def relative_errors(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normalised densities and their standard errors from batch sums.

    Parameters
    ----------
    sums : (..., batches, bins) float

    Returns
    -------
    share : (..., bins)     share of each bin; they add up to 1
    error : (..., bins)     relative standard error of the share (inf in an empty bin)
    """
    batches = sums.shape[-2]
    total = sums.sum(axis=(-2, -1))[..., None]
    share = sums.sum(axis=-2) / total
    residual = sums - share[..., None, :] * sums.sum(axis=-1, keepdims=True)
    deviation = np.sqrt((residual**2).sum(axis=-2) * (batches / (batches - 1))) / total
    with np.errstate(divide="ignore", invalid="ignore"):
        return share, np.where(share > 0.0, deviation / share, np.inf)


def worst_error(sums: np.ndarray) -> np.ndarray:
    """(...) largest relative error among the bins that hold more than 1 % of the mean."""
    share, error = relative_errors(sums)
    return np.where(share > 0.01 / share.shape[-1], error, 0.0).max(axis=-1)


def row_errors(sums: np.ndarray) -> np.ndarray:
    """(144,) `worst_error` of each row; of the worse band in a longitudinal one."""
    scores = sums[:, :, 0]
    bands = scores[AZIMUTH_ROWS:].reshape(PROFILE_THETAS, -1, 2, PROFILE_SINES)
    longitudinal = worst_error(np.moveaxis(bands, 2, 1)).max(axis=1)
    return np.concatenate([worst_error(scores[:AZIMUTH_ROWS]), longitudinal])


class Walker:
    """The kernel of one fibre, ready to add photons to any rows."""

    def __init__(self, device: Device, fibre: Fibre, seed: int) -> None:
        self.channels = absorption_channels(fibre)
        self.plan = plan_rows(fibre)
        features = Features(profile_channels=self.channels)
        self._kernel = cl.Kernel(program.build(device, "medulla.cl", features), "medulla_profiles")
        self._device, self._g, self._seed = device, fibre.g, seed
        n_rows = len(self.plan.rows)
        self.tally = Tally(
            np.zeros((n_rows, BATCHES, 1 + self.channels, PROFILE_PHIS)), np.zeros(n_rows, int)
        )

    def add(self, rows: np.ndarray, photons: np.ndarray) -> None:
        """Trace `photons` more in each batch of the given rows.

        Parameters
        ----------
        rows : (n,) int         distinct indices
        photons : (n,) int      > 0
        """
        tally, device = self.tally, self._device
        described = self.plan.rows.copy()
        described[rows, 9] = photons
        memory = Memory(device)
        shape = (len(rows), BATCHES, 1 + self.channels, PROFILE_PHIS)
        sums = memory.allocate("sums", 4 * math.prod(shape))
        stats = memory.allocate("stats", 8 * len(rows) * BATCHES)
        self._kernel(
            device.queue,
            (len(rows) * BATCHES,),
            (1,) if device.is_cpu else (64,),
            memory.upload("rows", described),
            memory.upload("job_rows", rows.astype(np.uint32)),
            memory.upload("centres", bin_centres()),
            np.float32(self._g),
            np.uint32(BATCHES),
            np.uint32(tally.photons.max()),
            np.uint32(self.plan.max_collisions),
            np.uint32(self._seed),
            sums,
            stats,
        )
        tally.sums[rows] += memory.read(sums, shape)
        counts = memory.read(stats, (len(rows), BATCHES, 2)).astype(np.float64).sum(axis=1)
        tally.photons[rows] += photons
        tally.collisions += counts[:, 0].sum()
        tally.given_up = max(tally.given_up, (counts[:, 1] / (photons * BATCHES)).max())


def simulate(device: Device, fibre: Fibre, seed: int, photons: int | None) -> Tally:
    """Trace photons until every row is good enough or the budget of collisions is spent.

    Parameters
    ----------
    photons : int or None   photons a row, rounded up to whole batches; None: as many as
                            TARGET_ERROR asks for

    Notes
    -----
    How many photons a row gets depends on the spread of its first ones, never on the time that
    they took: the result is a function of fibre, seed and device.
    """
    walker = Walker(device, fibre, seed)
    tally = walker.tally
    everything = np.arange(len(tally.photons))
    if photons is not None:
        walker.add(everything, np.full(len(everything), -(-photons // BATCHES)))
        return tally
    depth = float(walker.plan.rows[:, 0].max())
    first = max(1, round(FIRST_PHOTONS * min(1.0, 60.0 / (1.0 + depth))))
    walker.add(everything, np.full(len(everything), first))
    for _ in range(MAX_ROUNDS):
        errors = row_errors(tally.sums)
        poor = np.flatnonzero(errors > TARGET_ERROR)
        cost = tally.collisions / (tally.photons.sum() * BATCHES)
        left = (COLLISION_BUDGET - tally.collisions) / (cost * BATCHES)
        if not poor.size or left < len(poor):
            break
        have = tally.photons[poor]
        factor = np.minimum(1.1 * (errors[poor] / TARGET_ERROR) ** 2 - 1.0, GROWTH)
        wanted = np.maximum(have * np.maximum(factor, 0.2), 1.0)
        wanted *= min(1.0, left / wanted.sum())
        walker.add(poor, np.maximum(wanted.astype(int), 1))
    log.debug("medulla profiles: %.3g collisions, %s photons", tally.collisions, tally.photons)
    return tally
