"""Checks of what callers give to a render, before anything is set up."""

from __future__ import annotations

from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from furcl.errors import GroomError, SceneError
from furcl.groom.curves import Curves
from furcl.groom.joined import Grooms
from furcl.values import is_number, is_whole, shown

if TYPE_CHECKING:
    from furcl.scene.tables import Scene

#: Samples of a pixel are numbered by less than this, so that no kernel meets a sign bit.
MOST_SAMPLES = 1 << 31

Given = Curves | Grooms | Future[Curves] | Future[Grooms] | None
"""The groom or the grooms of a scene, where the caller has them or makes them."""


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


def check_samples(samples: Any, spp: int | None) -> None:
    """Refuse what is no range of samples, and a range beside a number of samples.

    Raises
    ------
    SceneError
    """
    if samples is None:
        return
    pair = isinstance(samples, tuple) and len(samples) == 2 and all(map(is_whole, samples))
    if not (pair and 0 <= samples[0] < samples[1] <= MOST_SAMPLES):
        raise SceneError(
            f"samples = {shown(samples)}: expected (first, end), whole numbers with "
            f"0 <= first < end <= {MOST_SAMPLES}"
        )
    if spp is not None:
        raise SceneError(f"samples = {shown(samples)} and spp = {spp}: give one of both")


def check_stops(progress: Any, time_limit: Any) -> None:
    """Refuse a progress that cannot be called, and a time limit that is no number from 0 on.

    Raises
    ------
    SceneError
    """
    if progress is not None and not callable(progress):
        raise SceneError(
            f"progress = {shown(progress)}: expected True, for a bar, or a function of paths done "
            f"and paths asked for"
        )
    if time_limit is not None and not (is_number(time_limit) and time_limit >= 0.0):
        raise SceneError(
            f"time_limit = {shown(time_limit)}: expected seconds, 0 or more; None for no limit"
        )


def grooms_of(scene: Scene, curves: Given) -> Grooms:
    """The grooms that a caller gives for a scene, waited for; else they are made.

    Raises
    ------
    GroomError
    """
    given = curves.result() if isinstance(curves, Future) else curves
    return scene.build_grooms() if given is None else Grooms.of(given)
