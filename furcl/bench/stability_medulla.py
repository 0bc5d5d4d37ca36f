"""The simulation of the medulla's profiles at the ends of its ranges."""

from __future__ import annotations

import dataclasses

import numpy as np

from furcl.bench.stability_row import Row
from furcl.device.choice import Device
from furcl.fibre.double_cylinder.layout import PROFILE_PHIS, PROFILE_SINES
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles

PHOTONS = 64
"""For each row: the tables are noisy, their normalisation and signs do not depend on it."""

# kappa, sigma_ms, g, sigma_ma. Deep, forward scattering media take most collisions: only once.
_MEDIA = (
    (1.0, 1e-8, 0.0, 0.0),
    (1e-6, 1.0, -0.99, 1.0),
    (1e-6, 1e4, 0.99, 1e4),
    (0.999, 50.0, 0.99, 1e-8),
    (1.0, 50.0, -1e-4, (1e-2, 1.0, 1e4)),
    (1.0, 1e4, -0.99, 1e4),
    (1.0, 1e4, 1e-4, 1e-8),
    (1.0, 1e4, 0.99, 0.0),
)


def medulla_rows(device: Device, quick: bool) -> list[Row]:
    """One row: values that are not finite or negative, and the largest error of an integral."""
    row = Row("profile", "TTs TRTs", value=1.0, reference=1.0)
    for kappa, sigma_ms, g, sigma_ma in _MEDIA[:5] if quick else _MEDIA:
        fibre = Fibre(kappa=kappa, sigma_ms=sigma_ms, g=g).replace(sigma_ma=sigma_ma)
        profiles = build_profiles(device, fibre, photons=PHOTONS, cache=False)
        assert profiles is not None
        row.count(profiles.pack()[:, None].astype(np.float64))
        sums = (
            profiles.azimuth.density.sum(-1, np.float64) * (2 * np.pi / PROFILE_PHIS),
            profiles.longitudinal.density.sum(-1, np.float64) * (2 / PROFILE_SINES),
        )
        error = max(float(np.abs(s - 1.0).max()) for s in sums)
        row.within_bars += profiles.pack().size * (error <= 1e-3)
        if not error <= row.max_relative:
            row.max_relative, row.excess = error, error / 1e-3
            row.worst = {"fibre": _values(fibre)}
    return [row]


def _values(fibre: Fibre) -> dict:
    values = dataclasses.asdict(fibre)
    values.pop("provenance")
    return values
