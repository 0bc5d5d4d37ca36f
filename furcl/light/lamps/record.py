"""Records of lamps on the host, in float64: the fields of `furcl.light.lamps.layout.LAMP`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.light.lamps.layout import KINDS

Array = NDArray[np.float64]
Records = NDArray[np.void]
"""Structured array of RECORD, one entry a lamp."""

RECORD = np.dtype(
    [
        ("kind", np.uint32),
        ("centre", np.float64, 3),
        ("axis", np.float64, 3),
        ("a", np.float64, 3),
        ("b", np.float64, 3),
        ("a_dual", np.float64, 3),
        ("b_dual", np.float64, 3),
        ("extent", np.float64),
        ("two_sided", np.float64),
        ("cos_inner", np.float64),
        ("cos_outer", np.float64),
        ("radiance", np.float64, 3),
    ]
)


def records(kind: str, n: int = 1, **fields: ArrayLike) -> Records:
    """`n` lamps of a kind; fields that are not given are zero.

    Parameters
    ----------
    fields : arrays     by name of RECORD, for all lamps or for each
    """
    out = np.zeros(n, RECORD)
    out["kind"] = KINDS.index(kind)
    for name, value in fields.items():
        out[name] = value
    return out


def is_kind(lamps: Records, kind: str) -> NDArray[np.bool_]:
    """Which lamps are of a kind."""
    return lamps["kind"] == KINDS.index(kind)


def dot(a: Any, b: Any) -> Array:
    """Products of rows (n, 3), (n,)."""
    return np.einsum("...i,...i->...", a, b)


def length(a: Any) -> Array:
    """Of rows (n, 3), (n,)."""
    return np.linalg.norm(a, axis=-1)


def unit(a: Any) -> Array:
    """Rows (n, 3) at unit length; zero of zero."""
    size = length(a)[..., None]
    return np.divide(a, size, out=np.zeros(np.shape(a)), where=size > 0.0)


def cone_directions(axes: Array, one_minus_cos: Array, turns: Array) -> Array:
    """Unit vectors (n, 3) at 1 - cos(theta) from unit axes (n, 3), azimuths in turns."""
    side = np.where(np.abs(axes[:, 2:]) > 0.5, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    tangent = unit(np.cross(side, axes))
    level = np.sqrt(np.maximum(one_minus_cos * (2.0 - one_minus_cos), 0.0))
    phi = 2.0 * np.pi * turns
    return (
        (level * np.cos(phi))[:, None] * tangent
        + (level * np.sin(phi))[:, None] * np.cross(axes, tangent)
        + (1.0 - one_minus_cos)[:, None] * axes
    )


def cone_density(one_minus_cos: Array) -> Array:
    """Density [1/sr] of directions uniform in cones; 0 of an empty one."""
    cone = 2.0 * np.pi * one_minus_cos
    return np.divide(1.0, cone, out=np.zeros_like(cone), where=cone > 0.0)
