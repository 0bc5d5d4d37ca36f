"""Computes the curves of lobes beside the render."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from furcl.errors import FurclError
from furcl.fibre.material import FibreMaterial
from furcl.viewer.lobes import curves

log = logging.getLogger(__name__)


class LobesThread:
    """A thread that computes the lobes of the fibres that were shown last; it leaves out those
    that others followed meanwhile.

    Parameters
    ----------
    tell : callable     takes a JSON text
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._wake = threading.Condition()
        self._wanted: list[tuple[str, Any, Any]] | None = None
        self._residual = self._closing = False
        self._done: dict[str, tuple[Any, bool]] = {}
        self._thread = threading.Thread(target=self._run, name="lobes")
        self._thread.start()

    def show(self, materials: Sequence[FibreMaterial], residual: bool) -> None:
        """Compute the lobes of materials, where they are not those that were computed last."""
        with self._wake:
            self._wanted = [(m.name, m.fibre, m.profiles) for m in materials]
            self._residual = residual
            self._wake.notify()

    def close(self) -> None:
        """End the thread, and wait for it."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._wake:
                while self._wanted is None and not self._closing:
                    self._wake.wait()
                if self._closing:
                    return
                wanted, self._wanted = self._wanted, None
                residual = self._residual
            assert wanted is not None
            for name, fibre, profiles in wanted:
                if self._done.get(name) == ((fibre, id(profiles)), residual):
                    continue
                if self._wanted is not None or self._closing:
                    break
                self._compute(name, fibre, profiles, residual)

    def _compute(self, name: str, fibre: Any, profiles: Any, residual: bool) -> None:
        try:
            found = curves(fibre, profiles, residual=residual)
        except (FurclError, NotImplementedError, ImportError) as error:
            log.info("lobes of %s: %s", name, error)
            return
        self._done[name] = ((fibre, id(profiles)), residual)
        text = msgspec.json.encode({"type": "lobes", "material": name, **found}).decode()
        self._tell(text)
