"""Grooms in other units and axes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import GroomError
from furcl.groom.curves import Curves, adopted
from furcl.groom.units import Units
from furcl.values import is_number, shown

#: Columns and signs that turn a groom so that an axis of it becomes z.
_TURNS = {"x": ((1, 2, 0), (1, 1, 1)), "y": ((0, 2, 1), (1, -1, 1)), "z": ((0, 1, 2), (1, 1, 1))}
UP_AXES = tuple(_TURNS)


def axis_up(curves: Curves, up_axis: str | None) -> str:
    """The axis of a groom that is up: one that is given, what its file says, or z."""
    return up_axis or curves.units.up_axis or "z"


def turned(points: NDArray[Any], axis: str) -> NDArray[Any]:
    """Points (n, 3) so turned that an axis of UP_AXES becomes z."""
    columns, signs = _TURNS[axis]
    return points[:, columns] * np.array(signs, points.dtype)


def z_up(curves: Curves, up_axis: str | None = None) -> Curves:
    """A groom turned to stand along +z, exactly; one with y up that faced +z faces -y.

    Parameters
    ----------
    up_axis : str       "x", "y" or "z"; None: what its file says, and z where that says none

    Raises
    ------
    GroomError          another axis
    """
    axis = axis_up(curves, up_axis)
    if axis not in _TURNS:
        raise GroomError(f"up axis = {shown(axis)}; it must be one of {', '.join(_TURNS)}.")
    units = Units(curves.units.metres, "z" if up_axis or curves.units.up_axis else None)
    points, steps = curves.points, curves.steps
    if axis != "z":
        points = turned(points, axis)
        points.flags.writeable = False
        if steps is not None:
            steps = np.stack([turned(step, axis) for step in steps])
            steps.flags.writeable = False
            points = steps[0]
    return dataclasses.replace(curves, points=points, steps=steps, units=units)


def scaled(curves: Curves, factor: float) -> Curves:
    """A groom all of whose lengths are multiplied by a factor > 0.

    Raises
    ------
    GroomError          another factor, or one that makes lengths that no groom has
    """
    if not is_number(factor) or not 0.0 < factor < float("inf"):
        raise GroomError(f"scale = {shown(factor)}; it must be positive and finite. Correct it.")
    if factor == 1.0:
        return curves
    with np.errstate(over="ignore", under="ignore"):
        points = (curves.points if curves.steps is None else curves.steps) * np.float32(factor)
        radii = curves.radii * np.float32(factor)
    return adopted(
        points,
        radii,
        curves.offsets,
        source=f"scale = {factor:g}",
        dropped=curves.dropped,
        attributes=curves.attributes,
        ignored=curves.ignored,
        units=curves.units.scaled(factor),
        times=curves.times or None,
    )
