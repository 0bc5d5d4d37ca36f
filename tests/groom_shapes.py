"""Measures of the strands of a groom, and parameters that leave out all that is random."""

from typing import Any

import numpy as np

PLAIN_HAIR: dict[str, Any] = {"n_clumps": 0, "frizz": 0.0, "wave_amplitude": 0.0, "flyaways": 0.0}
PLAIN_FUR: dict[str, Any] = {"n_clumps": 0, "frizz": 0.0, "length_noise": 0.0, "undercoat": 0.0}


def strands_of(curves):
    """Points (S, k, 3) float64 of a groom whose strands have equally many points."""
    counts = np.diff(curves.offsets)
    assert (counts == counts[0]).all()
    return curves.points.astype(np.float64).reshape(curves.n_strands, counts[0], 3)


def arc_lengths(curves):
    return np.linalg.norm(np.diff(strands_of(curves), axis=1), axis=2).sum(axis=1)


def mean_turn(curves):
    """Mean angle between neighbouring segments, summed along a strand [rad]."""
    step = np.diff(strands_of(curves), axis=1)
    step /= np.linalg.norm(step, axis=2, keepdims=True)
    cosine = (step[:, 1:] * step[:, :-1]).sum(axis=2)
    return np.arccos(np.clip(cosine, -1.0, 1.0)).sum(axis=1).mean()
