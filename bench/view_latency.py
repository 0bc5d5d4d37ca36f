"""Time from a change to the first picture of the live view, without server and browser.

python bench/view_latency.py [SCENE...] [--changes 12] [--device TEXT] [-o FILE.json]

For each scene at 256 x 256 the median and the 95th percentile over so many changes of each kind,
each asked for while the picture of the one before is rendered. A change of exposure or of the
number of samples takes no sample again; there the answer of the view is timed.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.scene.read import load_scene
from furcl.viewer.messages import Message, Orbit, Set
from furcl.viewer.picture import decoded
from furcl.viewer.session import Session

PATIENCE_S = 600.0
SCENES = ("black_hair", "white_hair", "raccoon")
#: Between an answer and the next change [s]: someone looks at the picture.
PAUSE_S = 0.5

# Kind of a change -> the n-th of them.
CHANGES: dict[str, Callable[[int], Message]] = {
    "camera": lambda n: Orbit(azimuth_deg=7.0, elevation_deg=0.0),
    "fibre": lambda n: Set(key="fibre.beta_m_deg", value=5.0 + 0.1 * (n % 100)),
    "medulla": lambda n: Set(key="fibre.kappa", value=0.4 + 0.001 * (n % 200)),
    "light": lambda n: Set(key="environment.sun_elevation_deg", value=30.0 + n % 40),
    "body": lambda n: Set(key="body.albedo", value=0.3 + 0.01 * (n % 50)),
    "exposure": lambda n: Set(key="film.exposure_stops", value=0.1 * (n % 10 + 1)),
    "samples": lambda n: Set(key="render.spp", value=1000 + n % 100),
    "groom": lambda n: Set(key="curves.radius", value=0.00151 + 0.0001 * (n % 10)),
}
NO_SAMPLE = ("exposure", "samples")


class Clock:
    """Waits for what a session says of a change: the first picture of a later revision, or, where
    no sample is taken again, the state."""

    def __init__(self, session: Session) -> None:
        self.session, self.revision, self.state = session, -1, {}
        self.picture, self.answer = threading.Event(), threading.Event()
        session.listen(self.hear)

    def hear(self, kind: str, message: str | bytes) -> None:
        if isinstance(message, bytes):
            revision = decoded(message)[0]["revision"]
            if revision > self.revision:
                self.revision = revision
                self.picture.set()
        elif kind == "state":
            self.state = msgspec.json.decode(message)
            self.answer.set()
        elif kind == "error":
            print(message, file=sys.stderr)

    def wait(self, for_what: threading.Event) -> None:
        if not for_what.wait(PATIENCE_S):
            raise TimeoutError("no answer of the view")

    def time(self, message: Message, *, of_picture: bool = True) -> float:
        """Seconds from asking to the answer."""
        awaited = self.picture if of_picture else self.answer
        awaited.clear()
        start = time.perf_counter()
        self.session.ask(message)
        self.wait(awaited)
        return time.perf_counter() - start


def in_turn(n: int) -> Iterator[tuple[str, Message]]:
    """Kinds and changes, n of each kind: those that leave the groom first."""
    for i in range(n):
        yield from ((kind, make(i)) for kind, make in CHANGES.items() if kind != "groom")
    yield from (("groom", CHANGES["groom"](i)) for i in range(n))


def measured(name: str, n: int, device: str | None) -> dict[str, Any]:
    """Seconds of each kind of change."""
    session = Session(load_scene(name, size="256x256"), device)
    try:
        clock = Clock(session)
        clock.wait(clock.picture)
        found: dict[str, list[float]] = {kind: [] for kind in CHANGES}
        # The first two of each kind compile what is compiled once.
        for i, (kind, message) in enumerate([*in_turn(2), *in_turn(n)]):
            time.sleep(PAUSE_S)
            seconds = clock.time(message, of_picture=kind not in NO_SAMPLE)
            if i >= 2 * len(CHANGES):
                found[kind].append(seconds)
        if session.failure:
            raise session.failure
    finally:
        session.close()
    return {"scene": name, "seconds": found, "load": os.getloadavg()[0]}


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--changes", type=int, default=12)
    parser.add_argument("--device")
    parser.add_argument("-o", "--output", type=Path)
    given = parser.parse_args()
    print("scene        change    median s   95 % s   load")
    scenes = []
    for name in given.scenes:
        found = measured(name, given.changes, given.device)
        scenes.append(found)
        for kind, seconds in found["seconds"].items():
            middle, high = np.quantile(seconds, [0.5, 0.95])
            print(f"{name:<12} {kind:<9} {middle:8.3f} {high:8.3f} {found['load']:6.1f}")
    if given.output:
        about = circumstances(open_device(given.device))
        write_json({**about, "changes": given.changes, "scenes": scenes}, given.output)


if __name__ == "__main__":
    main()
