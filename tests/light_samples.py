"""Directions and float64 values that light samples are compared with."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from offset_cells import wo_at

from furcl.rendering.probe import Probe

# Normal incidence, oblique, along and against the tilt, grazing.
THETAS = (0.0, 0.8, -1.1, 1.5)

# Backwards, off it, over the caustics of TRT, sideways, where TT ends, through, beyond half a turn.
PHIS = (0.0, 0.03, 0.35, -0.6, 1.4, 2.4, -2.9, 3.13, np.pi, 3.6, -4.0)

# Of wi from the mirrored inclination: in the middle of the lobes, and on a flank.
INCLINES = (0.0, 0.12)

N_SAMPLES = 20_000


class Found(NamedTuple):
    """The largest |z| of a mean estimate, and the largest estimate over the density that it says
    samples of the fibre have there."""

    z: float
    weight: float


def directions(theta: float) -> np.ndarray:
    """wi (n, 3) in the fibre's frame, for wo_at(theta)."""
    inclination = np.clip(np.repeat(-theta + np.array(INCLINES), len(PHIS)), -1.5, 1.5)
    phi = np.tile(PHIS, len(INCLINES))
    cosine = np.cos(inclination)
    return np.stack([np.sin(inclination), cosine * np.cos(phi), cosine * np.sin(phi)], axis=1)


def compare(
    probe: Probe, seed: int, far_field: Callable[..., np.ndarray], least: float = 0.0
) -> Found:
    """Estimates towards `directions` with the mean over h that a float64 reference says; the first
    channel. Directions of a smaller mean than `least` are left out: where few of N_SAMPLES offsets
    send any light, their spread is not the error."""
    z, weight = 0.0, 0.0
    residual = {"residual": True} if "residual" in probe.lobes else {}
    for i, theta in enumerate(THETAS):
        wo, wi = wo_at(theta), directions(theta)
        expected = far_field(probe.fibre, wo, wi, probe.material.profiles, **residual)[:, 0]
        many = np.repeat(wi, N_SAMPLES, axis=0)
        value, pdf = probe.estimate_far_field(wo, many, (seed + i) % 2**32)
        assert np.isfinite(value).all()
        assert (value >= 0.0).all()
        of_wi = value[:, 0].reshape(len(wi), -1).astype(np.float64)
        error = of_wi.std(axis=1) / np.sqrt(N_SAMPLES)
        # Steps of the profiles in phi under quadrature: test_far_field.py::test_nodes.
        off = np.abs(of_wi.mean(axis=1) - expected) / (error + 5e-4 * expected + 1e-9)
        compared = expected >= least
        assert compared.sum() > len(wi) // 2
        z = max(z, float(off[compared].max()))
        weight = max(weight, float((value.max(axis=1) / pdf).max()))
    return Found(z, weight)
