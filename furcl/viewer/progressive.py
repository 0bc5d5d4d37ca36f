"""The picture of a scene that changes: a small one at once, then all pixels, sample by sample."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from furcl.device.choice import Device
from furcl.errors import SceneError
from furcl.fibre.material import FibreMaterial
from furcl.image.image import Image
from furcl.rendering.adjustable import AdjustableRenderer
from furcl.scene.camera import Camera
from furcl.scene.tables import Film
from furcl.viewer import telling
from furcl.viewer.follow import Follower
from furcl.viewer.picture import Moments
from furcl.viewer.settings import Settings

#: The first picture after a change may render so long [s], as far as can be told.
FIRST_PICTURE_S = 0.05
#: Sides of the first picture are those of the picture over at least and at most this.
FINEST, COARSEST = 2, 16
#: Paths a second, until they are known.
GUESSED_RATE = 1e5
#: Time between two pictures, at first and at last [s], and over that which reading one takes.
SHORTEST_S, LONGEST_S, OVER_READING = 0.1, 1.0, 4.0
GROWTH = 1.5
#: Drafts are replaced when nothing was changed for so long [s].
CALM_S = 0.5


class Progressive:
    """Renders the settings that it follows, a step at a time.

    Parameters
    ----------
    device : Device
    pending : callable      true when a step is to end early
    prepared : callable     called, from another thread, when there is something to do again

    Attributes
    ----------
    moments : Moments or None       the picture so far, if it is whole and not the small one
    """

    def __init__(
        self, device: Device, pending: Callable[..., bool], prepared: Callable[[], None]
    ) -> None:
        self._follower = Follower(device)
        self._pending, self._prepared = pending, prepared
        self._rate = GUESSED_RATE
        self._spp = 0
        self._kept: Moments | None = None
        self._small: Moments | None = None
        self._at_first = True
        self._refined = False
        self._changed_at = 0.0
        self._interval = SHORTEST_S
        self.moments: Moments | None = None

    @property
    def camera(self) -> Camera | None:
        """That which sees the picture, resolved."""
        return self._follower.camera

    @property
    def materials(self) -> Sequence[FibreMaterial]:
        """Those of the scene."""
        return self._renderer.materials

    @property
    def at_first(self) -> bool:
        """Whether there is no picture yet since the last change, so that all else waits."""
        return self._at_first

    @property
    def drafted(self) -> list[str]:
        """Materials that are there as drafts."""
        return sorted(self._follower.drafted)

    @property
    def has_work(self) -> bool:
        """Whether a step would make the picture better."""
        if self._at_first or self._follower.is_prepared:
            return True
        kept = self._kept.whole_samples if self._kept else 0
        return kept + self._renderer.samples_done < self._spp

    @property
    def _renderer(self) -> AdjustableRenderer:
        assert self._follower.renderer is not None
        return self._follower.renderer

    def needs_set_up(self, settings: Settings) -> bool:
        """Whether `follow` will take long."""
        return self._follower.needs_set_up(settings.rendered())

    def follow(self, settings: Settings, kept: Moments | None) -> bool:
        """Render other settings from here on; returns whether their picture is another.

        Parameters
        ----------
        kept : Moments or None      samples that they have already: the first ones

        Raises
        ------
        FurclError      settings that cannot be rendered; what was followed is rendered on
        """
        scene = settings.rendered()
        anew = self._follower.follow(scene)
        self._spp = scene.render.spp
        if anew:
            self._begin(kept)
        elif self._kept:
            self._after_kept()
        return anew

    def _begin(self, kept: Moments | None) -> None:
        self._kept = self.moments = kept
        self._small = None
        self._at_first = kept is None
        self._interval, self._changed_at = SHORTEST_S, time.monotonic()
        if kept:
            self._renderer.restart(self._renderer.scene.render.seed, int(kept.samples.max()))
            self._after_kept()

    def _after_kept(self) -> None:
        assert self._kept is not None
        self._follower.set_spp(max(self._spp - self._kept.whole_samples, 0))

    def refined(self) -> bool:
        """Whether a draft was replaced since the last call."""
        refined, self._refined = self._refined, False
        return refined

    def step(self) -> bool:
        """Render for a moment; returns whether there is another picture to be shown."""
        if self._at_first:
            return self._first_picture()
        self._replace_drafts()
        renderer = self._renderer
        start, before = time.perf_counter(), renderer.paths_done
        renderer.advance(None, self._pending, self._interval)
        passed = time.perf_counter() - start
        if renderer.paths_done == before or self._pending():
            return False
        self._rate = (renderer.paths_done - before) / passed
        start = time.perf_counter()
        live = Moments(*renderer.film.read(renderer.memory))
        self.moments = self._kept.with_more(live) if self._kept else live
        reading = OVER_READING * (time.perf_counter() - start)
        self._interval = min(max(GROWTH * self._interval, reading), LONGEST_S)
        return True

    def _replace_drafts(self) -> None:
        if self._follower.is_prepared and self._follower.refine():
            self._refined = True
            self._begin(None)
            self._at_first = False  # what is shown is nearly right
        if time.monotonic() - self._changed_at > CALM_S:
            self._follower.prepare(self._prepared)

    def close(self) -> None:
        """Wait for what runs beside."""
        self._follower.close()

    def _first_picture(self) -> bool:
        renderer, film = self._renderer, self._renderer.scene.film
        renderer.show(_smaller(film, self._rate * FIRST_PICTURE_S))
        start = time.perf_counter()
        renderer.advance(1)
        self._rate = renderer.paths_done / (time.perf_counter() - start)
        self._small = Moments(*renderer.film.read(renderer.memory))
        self._at_first = False
        renderer.show(film)
        return True

    def shown(self, settings: Settings) -> tuple[Moments, dict[str, Any]] | None:
        """The picture to be shown and what is told of it."""
        moments = self.moments or self._small
        if moments is None:
            return None
        film = settings.scene.film
        coarse = self.moments is None
        return moments, telling.picture_facts(moments, film, self._spp, self._rate, coarse=coarse)

    def image(self, settings: Settings) -> Image:
        """The picture so far, with statistics.

        Raises
        ------
        SceneError      there is none yet
        """
        if self.moments is None:
            raise SceneError("there is no picture yet; wait for the first")
        samples = self.moments.whole_samples
        stats = {**self._renderer.stats(), "spp": samples, "layers": []}
        stats["complete"] = samples >= self._spp
        film = settings.scene.film
        return self.moments.image(stats, film.exposure_stops, film.window)


def _smaller(film: Film, pixels: float) -> Film:
    """The film with its sides divided by a whole number, so that it has about so many pixels."""
    window = film.window
    wanted = math.ceil(math.sqrt(window.n_pixels / max(pixels, 1.0)))
    by = min(max(wanted, FINEST), COARSEST, max(min(window.width, window.height) // 8, 1))
    width, height = math.ceil(film.width / by), math.ceil(film.height / by)
    crop = None
    if film.crop is not None:
        left, top, right, bottom = film.crop
        crop = left // by, top // by, min(-(-right // by), width), min(-(-bottom // by), height)
    return msgspec.structs.replace(film, width=width, height=height, crop=crop)
