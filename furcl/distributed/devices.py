"""Several devices of one machine that share a render."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Sequence

from furcl.device.choice import Device
from furcl.device.several import open_devices
from furcl.distributed.parts import Merging, Part, parts_of, render_part
from furcl.errors import DeviceError
from furcl.groom.joined import Grooms
from furcl.image.image import Image
from furcl.rendering.arguments import Given, check_curves, check_stops, grooms_of
from furcl.rendering.renderer import Progress, Renderer
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)


def render_on(
    scene: Scene | str | os.PathLike,
    devices: str | Sequence[str | Device],
    *,
    spp: int | None = None,
    seed: int | None = None,
    part_spp: int | None = None,
    progress: Progress | None = None,
    time_limit: float | None = None,
    wave_size: int | None = None,
    curves: Given = None,
) -> Image:
    """Render a scene on several devices, each of which takes part after part of the samples.

    Every device has all of the scene, with a tree of its own. A device that fails is left out, and
    another one takes its part; a device that has nothing left to do takes the part of one that is
    not ready, and the first of both counts. Which device took what changes no bit where all are of
    one kind.

    Parameters
    ----------
    scene : Scene or path
    devices : text or list      "all", numbers and names as `furcl.render` takes them with commas
                                between, or a list of such or of Devices
    part_spp : int or None      samples a pixel in each part (`furcl.distributed.parts.parts_of`)
    spp, seed, progress, time_limit, wave_size, curves      as for `furcl.render`

    Returns
    -------
    Image       with stats["parts"]: seed, first sample, number and device of each

    Raises
    ------
    DeviceError     no such device, or one that is named twice
    FurclError      as `furcl.render`: what the first device said, where all of them fail
    """
    check_stops(progress, time_limit)
    check_curves(curves)
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    scene = with_overrides(scene, spp=spp, seed=seed)
    parts = parts_of(scene, part_spp)
    opened = open_devices(devices)
    grooms = grooms_of(scene, curves)
    n_pixels = scene.film.width * scene.film.height
    work = _Work(parts, [d.name for d in opened], n_pixels, progress, time_limit)
    of_part = with_overrides(scene, spp=parts[0].spp)
    start = time.perf_counter()
    threads = [
        threading.Thread(target=_work_on, args=(work, i, device, of_part, wave_size, grooms))
        for i, device in enumerate(opened)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    image = work.picture()
    image.stats["seconds"]["wall"] = time.perf_counter() - start
    return image


def _work_on(
    work: _Work,
    worker: int,
    device: Device,
    scene: Scene,
    wave_size: int | None,
    grooms: Grooms,
) -> None:
    """What the thread of a device does."""
    part: Part | None = None
    try:
        renderer = Renderer(scene, device, wave_size, curves=grooms)
        while (part := work.take(worker)) is not None:
            image = render_part(renderer, part, work.watching(part))
            work.deliver(part, image)
    except Exception as error:  # a runtime raises what it likes, and the others go on
        work.fail(worker, part, error)


class _Work:
    """The parts of a render, and who has which; its methods may be called from any thread.

    Parameters
    ----------
    names : texts       of the devices
    n_pixels : int      of the film
    """

    def __init__(
        self,
        parts: list[Part],
        names: list[str],
        n_pixels: int,
        progress: Progress | None,
        time_limit: float | None,
    ) -> None:
        self._parts, self._names, self._n_pixels = parts, names, n_pixels
        self._changed = threading.Condition()
        self._waiting = deque(parts)
        self._running: dict[int, list[int]] = {}  # number of a part -> who works on it
        self._merging = Merging()
        self._done: set[int] = set()
        self._paths = dict.fromkeys((part.number for part in parts), 0)
        self._progress = progress
        self._end = None if time_limit is None else time.perf_counter() + time_limit
        self._stopped = False
        self._errors: list[Exception] = []

    def take(self, worker: int) -> Part | None:
        """A part for a device; None where there is nothing left to do.

        Where all are given out it is one that a single other device works on: that may be slow.
        """
        with self._changed:
            while not self._stopped and len(self._done) < len(self._parts):
                if self._waiting:
                    part = self._waiting.popleft()
                    self._running[part.number] = [worker]
                    return part
                alone = [n for n, workers in self._running.items() if len(workers) == 1]
                if alone:
                    number = min(alone, key=lambda n: self._paths[n] / self._parts[n].spp)
                    self._running[number].append(worker)
                    return self._parts[number]
                self._changed.wait()
            return None

    def watching(self, part: Part) -> Progress:
        """The progress of a part on a device; true once nobody needs it any more."""

        def after_wave(done: int, _: int) -> bool:
            with self._changed:
                self._paths[part.number] = max(self._paths[part.number], done)
                total = sum(p.spp for p in self._parts) * self._n_pixels
                if self._progress and self._progress(sum(self._paths.values()), total):
                    self._stopped = True
                if self._end is not None and time.perf_counter() >= self._end:
                    self._stopped = True
                if self._stopped:
                    self._changed.notify_all()
                return self._stopped or part.number in self._done

        return after_wave

    def deliver(self, part: Part, image: Image) -> None:
        """Take the picture of a part, unless it is there already."""
        with self._changed:
            if part.number not in self._done:
                self._done.add(part.number)
                self._merging.add(part, image)
            self._running.pop(part.number, None)
            self._changed.notify_all()

    def fail(self, worker: int, part: Part | None, error: Exception) -> None:
        """A device is left out; the part that it had waits again, if nobody else has it."""
        log.warning("%s is left out: %s", self._names[worker], error)
        with self._changed:
            self._errors.append(error)
            if part is not None and part.number not in self._done:
                workers = self._running[part.number]
                workers.remove(worker)
                if not workers:
                    del self._running[part.number]
                    self._paths[part.number] = 0
                    self._waiting.appendleft(part)
            self._changed.notify_all()

    def picture(self) -> Image:
        """The picture of the parts that are there.

        Raises
        ------
        Exception       of the first device, where all of them failed
        """
        image, whole = self._merging.image(), len(self._done) == len(self._parts)
        if image is None or not (whole or self._stopped):
            raise self._errors[0] if self._errors else DeviceError("no device took a part")
        image.stats["complete"] = whole and image.stats["complete"]
        return image
