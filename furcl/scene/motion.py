"""Transforms that change with time: their keys in scenes, and what is between them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from furcl.scene.transform import Transform
from furcl.table import Coordinate

#: A turn goes round in pieces of at most so much; the way of a point is then off its arc by
#: 1 - cos(half of it), 0.06 %, of its distance from the axis.
LARGEST_TURN_DEG = 4.0
_SAME_SCALE = 1e-5


class TransformKey(Transform, frozen=True, kw_only=True):
    """Where a groom is at a time.

    Of a list, `[[groom.NAME.keys]]`, in the order of time. Between two keys the scale, the angles
    and the translation change evenly, and those of matrices the matrix.

    Attributes
    ----------
    time : float        in the unit of camera.shutter
    """

    described_by: ClassVar = Transform

    time: Coordinate


def check_keys(keys: Sequence[TransformKey]) -> None:
    """Refuse keys between which nothing can move.

    Raises
    ------
    ValueError      a single key, times that do not increase, or scales that differ
    """
    if not keys:
        return
    check_key_times([key.time for key in keys])
    try:
        scales = [key.uniform_scale() for key in keys]
    except ValueError as error:
        raise ValueError(f"keys: one {error}") from None
    if max(scales) - min(scales) > _SAME_SCALE * max(scales):
        raise ValueError(
            f"keys: their scales are {min(scales):g} to {max(scales):g}; radii do not change with "
            f"time, give all keys the same scale"
        )


def check_key_times(times: Sequence[float]) -> None:
    """Refuse a single time, and times that do not increase.

    Raises
    ------
    ValueError
    """
    if len(times) < 2:
        raise ValueError(f"keys: there is one, at time {times[0]:g}; give two or more, or none")
    for i, (a, b) in enumerate(itertools.pairwise(times)):
        if not a < b:
            raise ValueError(
                f"keys[{i + 1}].time = {b:g}: expected more than {a:g}, the time of the key before"
            )


def key_times(keys: Sequence[TransformKey]) -> list[float]:
    """The times of keys, and those between them at which turns are followed."""
    times = [keys[0].time]
    for a, b in itertools.pairwise(keys):
        turn = 0.0
        if a.matrix is None and b.matrix is None:
            turn = float(np.abs(np.subtract(b.rotate_deg, a.rotate_deg)).sum())
        n = max(1, math.ceil(turn / LARGEST_TURN_DEG))
        times += [a.time + (b.time - a.time) * i / n for i in range(1, n)] + [b.time]
    return times


def matrix_at(keys: Sequence[TransformKey], time: float) -> NDArray[np.float64]:
    """The matrix (4, 4) at a time between the first key and the last."""
    times = [key.time for key in keys]
    i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(keys) - 2))
    a, b = keys[i], keys[i + 1]
    part = (time - a.time) / (b.time - a.time)
    if part in (0.0, 1.0):
        return (b if part else a).as_matrix()
    if a.matrix is not None or b.matrix is not None:
        return (1.0 - part) * a.as_matrix() + part * b.as_matrix()

    def between(name: str) -> tuple[float, float, float]:
        values = (np.broadcast_to(getattr(key, name), 3) for key in (a, b))
        x, y, z = ((1.0 - part) * u + part * v for u, v in zip(*values, strict=True))
        return float(x), float(y), float(z)

    return Transform(
        scale=between("scale"), rotate_deg=between("rotate_deg"), translate=between("translate")
    ).as_matrix()
