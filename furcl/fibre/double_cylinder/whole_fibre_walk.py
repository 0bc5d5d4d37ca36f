"""Launches the random walks behind simulated scattering and adds their light up.

The walks are in kernels/prepare/simulated.cl. Source: docs/model.md, Simulated scattering.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from furcl.device import program
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.fibre.double_cylinder.features import DoubleCylinderFeatures
from furcl.fibre.double_cylinder.layout import (
    SIMULATED_OFFSETS,
    SIMULATED_PHIS,
    SIMULATED_SINES,
    SIMULATED_THETAS,
)
from furcl.fibre.double_cylinder.medulla_walk import OPTICAL_RADIUS_CAP, TAU_CAP
from furcl.fibre.double_cylinder.parameters import Fibre

log = logging.getLogger(__name__)

ROWS = SIMULATED_THETAS * SIMULATED_OFFSETS
BATCHES = 16
"""Independent batches of each row; their spread gives the standard errors."""

FIRST_PHOTONS = 8
MOST_PHOTONS = 1024
COLLISION_BUDGET = 12e6
"""Photons of each batch at first, and at most; collisions of all, of which each counts in 16
directions."""


@dataclass
class Tally:
    """Sums of the walks.

    Attributes
    ----------
    energy : (rows, BATCHES, channels, phis, sines) float64     that left in each cell
    photons : int           of each batch
    collisions : float      of all photons
    given_up : float        share of the photons that outlived the limit on collisions
    """

    energy: np.ndarray
    photons: int = 0
    collisions: float = 0.0
    given_up: float = 0.0


def table_channels(fibre: Fibre) -> int:
    """Channels of absorption in the tables: 0 without any, 1 if grey, else 3."""
    if not any(fibre.sigma_ma) and not any(fibre.sigma_ca):
        return 0
    return 1 if len(set(fibre.sigma_ma)) == 1 and len(set(fibre.sigma_ca)) == 1 else 3


def inner_sines(fibre: Fibre) -> np.ndarray:
    """(SIMULATED_THETAS,) sine of the inclination inside, for sin(theta_i) even from 0 to 1."""
    return np.linspace(0.0, 1.0, SIMULATED_THETAS) / fibre.eta


def kernel_features(fibre: Fibre) -> Features:
    """The features of kernels/prepare/simulated.cl."""
    channels = table_channels(fibre)
    return Features(fibre=DoubleCylinderFeatures(simulated=True, profile_channels=channels))


def _described(fibre: Fibre) -> tuple[np.ndarray, np.ndarray, int]:
    """What the kernel reads, float32: rows (ROWS, 4), the fibre; and after how many collisions a
    photon is given up.

    A medulla denser than the caps of medulla_walk is walked as there: with less scattering and
    absorption in proportion.
    """
    angle = np.linspace(0.0, 0.5 * np.pi, SIMULATED_OFFSETS)
    sine = np.repeat(inner_sines(fibre), SIMULATED_OFFSETS)
    rows = np.stack(
        [
            sine,
            np.sqrt((1.0 - sine) * (1.0 + sine)),
            np.tile(np.sin(angle), SIMULATED_THETAS),
            np.tile(np.append(np.cos(angle[:-1]), 0.0), SIMULATED_THETAS),
        ],
        axis=1,
    )
    wanted = max(fibre.kappa * fibre.sigma_ms, 1e-30)
    tau = min(wanted, OPTICAL_RADIUS_CAP / (1.0 - fibre.g), TAU_CAP)
    channels = max(table_channels(fibre), 1)
    medulla = fibre.kappa * (tau / wanted) * np.array(fibre.sigma_ma[:channels])
    shape = (fibre.eta, fibre.kappa, 1.0 - fibre.kappa, fibre.layers, fibre.g, tau)
    radius = tau * (1.0 - fibre.g)
    limit = math.ceil((256.0 + 24.0 * radius**2) / (1.0 - abs(fibre.g)))
    described = np.array([*shape, *medulla, *fibre.sigma_ca[:channels]])
    return rows.astype(np.float32), described.astype(np.float32), limit


def simulate(device: Device, fibre: Fibre, seed: int, photons: int | None) -> Tally:
    """Trace `photons` for each row, rounded up to whole batches; None: as many as the budget of
    collisions allows.

    How many that is follows from the collisions of the first ones, never from time: the result is
    a function of fibre, seed and device.
    """
    channels = max(table_channels(fibre), 1)
    tally = Tally(np.zeros((ROWS, BATCHES, channels, SIMULATED_PHIS, SIMULATED_SINES)))
    built = program.build(device, "prepare/simulated.cl", kernel_features(fibre))
    described = _described(fibre)
    first = FIRST_PHOTONS if photons is None else max(1, -(-photons // BATCHES))
    _add(device, built, tally, described, seed, first)
    if photons is None:
        affordable = COLLISION_BUDGET / max(tally.collisions, 1.0) * first
        more = int(min(affordable, MOST_PHOTONS)) - first
        if more > 0:
            _add(device, built, tally, described, seed, more)
    log.debug("simulated scattering: %.3g collisions", tally.collisions)
    return tally


def _add(
    device: Device,
    built: cl.Program,
    tally: Tally,
    described: tuple[np.ndarray, np.ndarray, int],
    seed: int,
    photons: int,
) -> None:
    """Trace `photons` more in each batch."""
    rows, fibre, limit = described
    memory = Memory(device)
    sums = memory.allocate("sums", 4 * math.prod(tally.energy.shape))
    stats = memory.allocate("stats", 8 * ROWS * BATCHES)
    program.kernel_of(built, "scattered_light")(
        device.queue,
        (ROWS * BATCHES,),
        (1,) if device.is_cpu else (32,),
        memory.upload("rows", rows),
        memory.upload("fibre", fibre),
        *(np.uint32(n) for n in (BATCHES, photons, tally.photons, limit, seed)),
        sums,
        stats,
    )
    counts = memory.read(stats, (ROWS * BATCHES, 2)).astype(np.float64).sum(axis=0)
    tally.energy += memory.read(sums, tally.energy.shape)
    lost = tally.given_up * tally.photons + counts[1] / (ROWS * BATCHES)
    tally.photons += photons
    tally.collisions += counts[0]
    tally.given_up = lost / tally.photons
