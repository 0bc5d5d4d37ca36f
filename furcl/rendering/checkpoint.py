"""Renders that go on: when their state is kept, and whether one belongs to a render."""

from __future__ import annotations

import logging
import math
import os
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from furcl.errors import CheckpointError, FurclError
from furcl.files import check_writable
from furcl.rendering.arguments import Given
from furcl.rendering.state import Part, Saved, read_parts, write_state
from furcl.scene.digest import digest, scene_digest
from furcl.values import is_number, shown

if TYPE_CHECKING:
    from furcl.rendering.renderer import Renderer

log = logging.getLogger(__name__)

#: What a state may differ in and still be gone on from: another device adds samples that are as
#: good, but not the same bits.
_MAY_DIFFER = ("device",)


class Checkpoints:
    """Keeps the state of a render in a file.

    Parameters
    ----------
    renderer : Renderer
    curves : Given          the scene's groom or grooms
    path : path             of the file, which appears whole or not at all
    minutes : float or None     kept so often; None: only where `keep` is called

    """

    def __init__(
        self,
        renderer: Renderer,
        curves: Given,
        path: str | os.PathLike[str],
        minutes: float | None = None,
    ) -> None:
        self.path = Path(path)
        self._renderer, self._curves = renderer, curves
        self._interval = None if minutes is None else 60.0 * minutes
        self._last = time.monotonic()
        self._identity: dict[str, Any] | None = None
        self._stopped = False

    def watching(self, progress: Callable[[int, int], bool | None] | None) -> Callable[..., bool]:
        """A progress that calls another one and keeps the state when that is due."""

        def after_wave(done: int, total: int) -> bool:
            self._stopped = bool(progress and progress(done, total))
            if self._interval is not None and time.monotonic() - self._last >= self._interval:
                self.keep()
            return self._stopped

        return after_wave

    def end(self) -> None:
        """Keep the state at the end, if it was stopped or is kept regularly."""
        if self._stopped or self._interval is not None:
            self.keep()

    def keep(self) -> bool:
        """Keep the state; returns whether that was possible, and logs why it was not."""
        try:
            if self._identity is None:
                self._identity = identity(self._renderer, self._curves)
            numbers, parts = _state(self._renderer)
            write_state(self.path, self._renderer.device.queue, self._identity, numbers, parts)
        except (OSError, FurclError) as error:
            log.warning(
                "%s: the render cannot be kept there: %s",
                self.path,
                getattr(error, "strerror", None) or error,
            )
            return False
        finally:
            self._last = time.monotonic()
        log.debug("kept the render in %s", self.path)
        return True


def check_checkpoints(path: Any, minutes: Any) -> None:
    """Refuse a file that could not be written, and an interval that is no number above 0.

    Raises
    ------
    CheckpointError
    """
    if path is not None:
        check_writable(path, CheckpointError)
    if minutes is not None and not (is_number(minutes) and 0.0 < minutes < math.inf):
        raise CheckpointError(
            f"minutes between checkpoints = {shown(minutes)}: expected a number above 0"
        )
    if minutes is not None and path is None:
        raise CheckpointError(f"checkpoint_minutes = {minutes}: there is no file; give checkpoint")


def go_on(
    renderer: Renderer,
    curves: Given,
    saved: Saved,
) -> None:
    """Give a renderer the state that a file holds.

    Raises
    ------
    CheckpointError     a state of another render, or of more samples than are asked for
    """
    path = saved.path
    here = identity(renderer, curves)
    differ = _differences(saved.identity, here)
    refused = [said for key, said in differ.items() if key not in _MAY_DIFFER]
    if refused:
        raise CheckpointError(
            f"{path}: is of another render: {'; '.join(refused)}; go on with the scene, options "
            f"and version of furcl that it was begun with"
        )
    if differ:
        log.warning("%s: %s: the bits are not those of one device", path, *differ.values())
    most = renderer.scene.render.spp * renderer.n_pixels
    if saved.numbers["paths_done"] > most:
        raise CheckpointError(
            f"{path}: holds {saved.numbers['paths_done'] / renderer.n_pixels:.6g} samples a pixel, "
            f"{renderer.scene.render.spp} are asked for; ask for as many or more"
        )
    _, parts = _state(renderer)
    read_parts(renderer.device.queue, saved, parts)
    _set_numbers(renderer, saved.numbers)
    log.info("going on from %s, with %d samples a pixel", path, renderer.samples_done)


def identity(renderer: Renderer, curves: Given) -> dict[str, Any]:
    """What the picture of a renderer follows from, as JSON values; samples a pixel only where
    the plan of all of them depends on their number."""
    scene, device = renderer.scene, renderer.device
    settings = msgspec.to_builtins(scene.render)
    if renderer.plan is None:
        del settings["spp"]
    groom = curves.result() if isinstance(curves, Future) else curves
    return {
        "scene": scene_digest(scene, groom),
        "size": [scene.film.width, scene.film.height],
        "render": settings,
        "first_sample": renderer.first_sample,
        "target": renderer.target.as_dict() if renderer.target else None,
        "kernels": digest(*renderer.wavefront.texts()),
        "device": [device.name, device.platform, device.driver_version],
    }


def _differences(saved: dict[str, Any], here: dict[str, Any]) -> dict[str, str]:
    """Key -> what is said of it, of those that differ."""
    said = {}
    for key, value in here.items():
        before = saved.get(key)
        if before == value:
            continue
        if isinstance(value, dict) and isinstance(before, dict):
            names = sorted(name for name in value if before.get(name) != value[name])
            said[key] = ", ".join(f"{n} was {before.get(n)}, is {value[n]}" for n in names)
        elif key in ("scene", "kernels"):
            said[key] = f"another {key.removesuffix('s')}"
        else:
            said[key] = f"{key} was {before}, is {value}"
    return said


#: Attributes of a renderer that count.
_COUNTS = ("paths_done", "rays", "shadow_rays", "hits", "surface_hits", "misses")


def _state(renderer: Renderer) -> tuple[dict[str, Any], dict[str, Part]]:
    """Numbers, and parts that are read and filled in place."""
    renderer.count_lobes()
    numbers: dict[str, Any] = {name: getattr(renderer, name) for name in _COUNTS}
    numbers["seconds"] = renderer.seconds.get("render", 0.0)
    film = renderer.film
    parts: dict[str, Part] = {
        "film": film.sums,
        "samples": film.n_samples,
        "nonfinite": film.nonfinite,
        "material hits": renderer.material_hits,
    }
    parts |= {f"lobes of material {i}": counts for i, counts in enumerate(renderer.lobe_counts)}
    if film.layers:
        parts |= film.layers.parts()
    if renderer.plan:
        numbers["plan"] = renderer.plan.numbers()
        parts |= renderer.plan.parts()
    if renderer.setup.learning:
        parts |= renderer.setup.learning.parts()
    return numbers, parts


def _set_numbers(renderer: Renderer, numbers: dict[str, Any]) -> None:
    for name in _COUNTS:
        setattr(renderer, name, numbers[name])
    renderer.seconds["render"] = numbers["seconds"]
    renderer.lobes_are_counted()
    if renderer.plan:
        renderer.plan.go_on(numbers["plan"])
