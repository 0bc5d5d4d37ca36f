"""A page without a browser: talks to the server of the live view as the page does."""

from __future__ import annotations

import json
import time
from contextlib import ExitStack
from typing import Any
from urllib.parse import urlsplit

from numpy.typing import NDArray
from websockets.sync.client import ClientConnection, connect

from furcl.viewer.picture import decoded

SCENE = {
    "name": "patch",
    "camera": {"azimuth_deg": 20.0, "elevation_deg": 20.0},
    "film": {"width": 32, "height": 24},
    "fibre": {"model": "chiang", "preset": "brown"},
    "environment": {"kind": "constant"},
    "curves": {"generator": "fur", "n_strands": 200, "radius": 0.02},
    # Nothing is learned, so a pixel is the same in every window.
    "render": {"spp": 4, "seed": 1, "roulette": "depth"},
}
PATIENCE_S = 300.0


class Page:
    """One connection."""

    def __init__(self, address: str) -> None:
        parts = urlsplit(address)
        self._open = ExitStack()
        self.socket: ClientConnection = self._open.enter_context(
            connect(
                f"ws://{parts.netloc}{parts.path}socket",
                origin=f"http://{parts.netloc}",  # pyright: ignore[reportArgumentType]
                max_size=None,
            )
        )
        self.state: dict[str, Any] = {}
        self.last: tuple[dict[str, Any], NDArray[Any]] | None = None

    def send(self, do: str, **values: Any) -> None:
        self.socket.send(json.dumps({"do": do, **values}))

    def next(self) -> tuple[dict[str, Any], NDArray[Any] | None]:
        message = self.socket.recv(timeout=PATIENCE_S)
        if isinstance(message, bytes):
            self.last = decoded(message)
            return self.last
        found = json.loads(message)
        if found["type"] == "state":
            self.state = found
        return found, None

    def wait(self, kind: str, **facts: Any) -> tuple[dict[str, Any], NDArray[Any] | None]:
        """The next message of a type that says these things."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            found, pixels = self.next()
            if found["type"] == kind and all(found.get(k) == v for k, v in facts.items()):
                return found, pixels
        raise TimeoutError(f"no {kind} with {facts}")

    def whole(self, spp: int = 4, **facts: Any) -> tuple[dict[str, Any], NDArray[Any]]:
        """The picture of what the state says, when it has all samples. The state may go on while it
        is waited for: changes that were sent before are told one after the other."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            now = {"slot": self.state["slot"], "revision": self.state["revision"]}
            wanted = {**facts, **now, "samples": spp, "coarse": False}
            if self.last and all(self.last[0].get(k) == v for k, v in wanted.items()):
                return self.last
            self.next()
        raise TimeoutError(f"no whole picture with {facts}")

    def close(self) -> None:
        self._open.close()
