"""Shows a render on a display while it grows."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from furcl.image.tev import Display

if TYPE_CHECKING:
    from furcl.rendering.renderer import Renderer

#: Time between two pictures [s], and over that which one takes.
INTERVAL_S = 1.0
OVER_SENDING = 10.0


class Shown:
    """Sends what a renderer has to a tev.

    Parameters
    ----------
    address : str       HOST:PORT

    Raises
    ------
    ImageError          another address
    """

    def __init__(self, renderer: Renderer, address: str) -> None:
        self._renderer = renderer
        self._display = Display(address, f"{renderer.scene.name} (furcl)")
        self._next = 0.0

    def watching(self, progress: Callable[[int, int], bool | None] | None) -> Callable[..., bool]:
        """A progress that calls another one and sends the picture when that is due."""

        def after_wave(done: int, total: int) -> bool:
            stopped = bool(progress and progress(done, total))
            if time.monotonic() >= self._next:
                self.send()
            return stopped

        return after_wave

    def send(self) -> None:
        """Send the picture so far."""
        start, renderer = time.monotonic(), self._renderer
        mean, _, samples = renderer.film.read(renderer.memory)
        self._display.show(mean, samples, renderer.window)
        now = time.monotonic()
        self._next = now + max(INTERVAL_S, OVER_SENDING * (now - start))

    def end(self) -> None:
        """Send the whole picture, and end the connection."""
        self.send()
        self._display.close()
