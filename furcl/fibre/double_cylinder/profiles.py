"""Profiles of the light that a medulla scatters, simulated for one material.

Source: docs/model.md, Medulla; Yan et al. 2015 and 2017 tabulate the same for all materials.
Changed: one material only (so no limit on sigma_ms and g and no tensor compression), absorption
exact as weights exp(-sigma_ma l) instead of a mean length, profiles of h up to the rim.

Proofs: tests/test_medulla.py holds the tables against an analog walk that shares nothing with them.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from furcl import cache as cache_files
from furcl.cdf import inclusive_cdf
from furcl.device.choice import Device
from furcl.device.source import kernel_text
from furcl.fibre.double_cylinder.layout import (
    PROFILE_OFFSETS,
    PROFILE_PHIS,
    PROFILE_SINES,
    PROFILE_TAUS,
    PROFILE_THETAS,
)
from furcl.fibre.double_cylinder.medulla_walk import (
    Tally,
    absorption_channels,
    kernel_features,
    relative_errors,
    simulate,
    worst_errors,
)
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.paths import cache_folder

FORMAT_VERSION = 1
DEFAULT_SEED = 1
DRAFT_PHOTONS = 24


@dataclass(frozen=True, eq=False)
class AzimuthProfiles:
    """What leaves in each direction phi, for light at theta = 0.

    Rows: cos(theta_t) from 1 down to sqrt(1 - 1/eta^2) at four even nodes, which stand for
    tau' = kappa sigma_ms / cos(theta_t), and h = sin(j pi / 62), j = 0..31, relative to the
    medulla's radius. Bins: 128 of phi_q over [-pi, pi); phi_q = pi is straight through.

    Attributes
    ----------
    density : (4, 32, 128) float32      Dhat [1/rad], integral 1, of photons scattered at least once
    cdf : (4, 32, 128) float32          its inclusive running integral, last entry exactly 1
    absorption : (4, 32, 128, channels) float32 or None     mean of exp(-sigma_ma' l), in [0, 1]
    relative_error : (4, 32, 128) float32   standard error of density over density
    """

    density: np.ndarray
    cdf: np.ndarray
    absorption: np.ndarray | None
    relative_error: np.ndarray


@dataclass(frozen=True, eq=False)
class LongitudinalProfiles:
    """What leaves at each s = sin(theta_o), in the bands |phi| < pi/8 (back) and > 7 pi/8 (front).

    Rows: theta_i even over 0..pi/2 at 16 nodes, tau = kappa sigma_ms, light uniform over h.

    Attributes
    ----------
    density : (16, 2, 64) float32           over s in [-1, 1], integral 1
    cdf : (16, 2, 64) float32               inclusive, last entry exactly 1
    relative_error : (16, 2, 64) float32    standard error of density over density
    """

    density: np.ndarray
    cdf: np.ndarray
    relative_error: np.ndarray


@dataclass(frozen=True, eq=False)
class MedullaProfiles:
    """All tables of one material.

    Attributes
    ----------
    azimuth : AzimuthProfiles
    longitudinal : LongitudinalProfiles
    escape : (4, 32, channels) float32 or None
        share of the scattered light that medulla absorption lets out: sum of density * absorption;
        None without absorption, when it is 1
    relative_error : float
        largest relative standard error among the bins of either density that hold more than 1 %
        of their row's mean
    photons : int           photons traced
    given_up : float        largest share of a row's photons that outlived the limit on collisions
    """

    azimuth: AzimuthProfiles
    longitudinal: LongitudinalProfiles
    escape: np.ndarray | None
    relative_error: float
    photons: int
    given_up: float

    @property
    def channels(self) -> int:
        """Channels of absorption: 0, 1 or 3."""
        return 0 if self.escape is None else self.escape.shape[-1]

    def pack(self, channels: int | None = None) -> np.ndarray:
        """The float32 blocks that profiles.clh of the model reads, one after the other.

        `channels` of absorption (default: those there are) may be more than the material needs.
        """
        channels = self.channels if channels is None else channels
        blocks = [self.azimuth.cdf]
        if channels:
            shape = (*self.azimuth.cdf.shape, channels)
            one = np.ones(1, np.float32)
            absorption, escape = self.azimuth.absorption, self.escape
            blocks += [
                np.broadcast_to(one if absorption is None else absorption, shape),
                np.broadcast_to(one if escape is None else escape, (*shape[:2], channels)),
            ]
        blocks += [self.longitudinal.density, self.longitudinal.cdf]
        return np.concatenate([block.ravel() for block in blocks])


def build_profiles(
    device: Device,
    fibre: Fibre,
    *,
    seed: int = DEFAULT_SEED,
    photons: int | None = None,
    cache: bool = True,
) -> MedullaProfiles | None:
    """Load the profiles of a fibre's medulla, or simulate and store them.

    Parameters
    ----------
    device : Device
    fibre : Fibre
    seed : int              >= 0; the result is a function of fibre, seed, photons and device
    photons : int or None   photons for each of the 144 rows; None traces until the relative
                            error is below 2 % or a budget is spent
    cache : bool            read and write the cache folder (`furcl.paths.cache_folder`)

    Returns
    -------
    MedullaProfiles, or None if the fibre has no medulla that scatters
    """
    if not fibre.has_medulla:
        return None

    def made() -> dict[str, np.ndarray]:
        return _arrays(simulate(device, fibre, seed, photons))

    content = _content(device, fibre, seed, photons)
    return _profiles(cached(content, _shapes(fibre), made) if cache else made())


def draft_profiles(device: Device, fibre: Fibre) -> tuple[MedullaProfiles | None, bool]:
    """The stored profiles of a fibre's medulla, and False; if there are none, some of DRAFT_PHOTONS
    photons a row, which are not stored, and True."""
    if not fibre.has_medulla:
        return None, False
    path = cache_path(_content(device, fibre, DEFAULT_SEED, None))
    arrays = load_cached(path, _shapes(fibre))
    if arrays is not None:
        return _profiles(arrays), False
    return build_profiles(device, fibre, photons=DRAFT_PHOTONS, cache=False), True


def _content(device: Device, fibre: Fibre, seed: int, photons: int | None) -> dict:
    """All that decides the tables."""
    parameters = {name: getattr(fibre, name) for name in ("eta", "kappa", "sigma_ms", "g")}
    kernel = kernel_text("prepare/medulla.cl", kernel_features(fibre))
    return {
        **parameters,
        "sigma_ma": fibre.sigma_ma,
        "seed": seed,
        "photons": photons,
        "format": FORMAT_VERSION,
        "device": (device.name, device.platform, device.driver_version),
        "kernel": hashlib.sha256(kernel.encode()).hexdigest(),
    }


def _shapes(fibre: Fibre) -> dict[str, tuple[int, ...]]:
    channels = absorption_channels(fibre)
    phis = (PROFILE_TAUS, PROFILE_OFFSETS, PROFILE_PHIS)
    sines = (PROFILE_THETAS, 2, PROFILE_SINES)
    shapes: dict[str, tuple[int, ...]] = {
        "azimuth_share": phis,
        "azimuth_error": phis,
        "longitudinal_share": sines,
        "longitudinal_error": sines,
        "summary": (3,),
    }
    if channels:
        shapes["absorption"] = (*phis, channels)
    return shapes


def _arrays(tally: Tally) -> dict[str, np.ndarray]:
    """Tables as they are stored: shares of bins (float64), errors, absorption."""
    phis = (PROFILE_TAUS, PROFILE_OFFSETS, PROFILE_PHIS)
    sines = (PROFILE_THETAS, 2, PROFILE_SINES)
    scores = tally.azimuth[:, :, 0]
    share, error = relative_errors(scores)
    s_share, s_error = relative_errors(tally.longitudinal)
    worst = max(worst_errors(scores).max(), worst_errors(tally.longitudinal).max())
    limit = np.finfo(np.float32).max
    arrays = {
        "azimuth_share": share.reshape(phis),
        "azimuth_error": np.minimum(error, limit).reshape(phis).astype(np.float32),
        "longitudinal_share": s_share.reshape(sines),
        "longitudinal_error": np.minimum(s_error, limit).reshape(sines).astype(np.float32),
        "summary": np.array([worst, tally.photons, tally.given_up]),
    }
    if tally.azimuth.shape[2] > 1:
        sums = tally.azimuth.sum(axis=1)
        weight = np.maximum(sums[:, :1], np.finfo(np.float64).tiny)
        absorption = np.minimum(sums[:, 1:] / weight, 1.0)
        arrays["absorption"] = np.moveaxis(absorption, 1, 2).reshape(*phis, -1).astype(np.float32)
    return arrays


def _profiles(arrays: dict[str, np.ndarray]) -> MedullaProfiles:
    share, s_share = arrays["azimuth_share"], arrays["longitudinal_share"]
    absorption = arrays.get("absorption")
    escape = None
    if absorption is not None:
        escape = (share[..., None] * absorption).sum(axis=2).astype(np.float32)
    worst, photons, given_up = arrays["summary"]
    return MedullaProfiles(
        AzimuthProfiles(
            (share * (PROFILE_PHIS / (2.0 * np.pi))).astype(np.float32),
            inclusive_cdf(share),
            absorption,
            arrays["azimuth_error"],
        ),
        LongitudinalProfiles(
            (s_share * (PROFILE_SINES / 2.0)).astype(np.float32),
            inclusive_cdf(s_share),
            arrays["longitudinal_error"],
        ),
        escape,
        float(worst),
        int(photons),
        float(given_up),
    )


def cache_path(content: dict[str, Any]) -> Path:
    """The file for tables that are made from `content` (plain values)."""
    text = json.dumps(content, sort_keys=True)
    return cache_folder() / "medulla" / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.tables"


def cached(
    content: dict[str, Any],
    shapes: dict[str, tuple[int, ...]],
    made: Callable[[], dict[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """The stored tables that `content` decides; if there are none, those that are made, stored."""
    path = cache_path(content)
    arrays = load_cached(path, shapes)
    if arrays is None:
        arrays = made()
        store_cached(path, arrays)
    return arrays


def load_cached(path: Path, shapes: dict[str, tuple[int, ...]]) -> dict[str, np.ndarray] | None:
    """The arrays of a file, or None if it is absent, damaged or not of these shapes."""
    content = cache_files.load(path)
    if content is None:
        return None
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except Exception as error:  # whatever zip, numpy and Python's parser raise
        cache_files.refuse(path, error)
        return None
    found = {name: array.shape for name, array in arrays.items()}
    if found != shapes or not all(np.isfinite(a).all() for a in arrays.values()):
        cache_files.refuse(path, "its tables are others")
        return None
    return arrays


def store_cached(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a file; see furcl.cache.store."""
    file = io.BytesIO()
    np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
    cache_files.store(path, file.getvalue())
