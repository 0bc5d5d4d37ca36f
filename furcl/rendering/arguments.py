"""Checks of what callers give to a render, before anything is set up."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any

from furcl.errors import GroomError, SceneError
from furcl.groom.curves import Curves
from furcl.groom.joined import Grooms
from furcl.values import is_number, shown


def check_curves(curves: Any) -> None:
    """Refuse what is neither a groom nor one that is being made.

    Raises
    ------
    GroomError
    """
    if curves is not None and not isinstance(curves, Curves | Grooms | Future):
        raise GroomError(
            f"curves = {shown(curves)}: expected Curves; furcl.load_curves reads a file, and "
            f"Curves.from_arrays makes them of arrays."
        )


def check_stops(progress: Any, time_limit: Any) -> None:
    """Refuse a progress that cannot be called, and a time limit that is no number from 0 on.

    Raises
    ------
    SceneError
    """
    if progress is not None and not callable(progress):
        raise SceneError(
            f"progress = {shown(progress)}: expected a function of paths done and paths asked for"
        )
    if time_limit is not None and not (is_number(time_limit) and time_limit >= 0.0):
        raise SceneError(
            f"time_limit = {shown(time_limit)}: expected seconds, 0 or more; None for no limit"
        )
