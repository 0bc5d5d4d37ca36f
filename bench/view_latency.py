"""Time from a change to the first picture of the live view, without server and browser.

python bench/view_latency.py [SCENE ...] [--changes N]: for each scene at 256 x 256 the median and
the 95th percentile over N changes of the camera, of the fibre's numbers, and of its medulla, with
the load of the machine beside them.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import threading
import time
from collections.abc import Iterator

from furcl.scene.read import load_scene
from furcl.viewer.messages import Message, Orbit, Set
from furcl.viewer.picture import decoded
from furcl.viewer.session import Session

PATIENCE_S = 600.0


class Clock:
    """Waits for the first picture of a revision that is later than the last one."""

    def __init__(self, session: Session) -> None:
        self.session, self.revision = session, -1
        self.first = threading.Event()
        session.listen(self.hear)

    def hear(self, kind: str, message: str | bytes) -> None:
        if isinstance(message, bytes):
            revision = decoded(message)[0]["revision"]
            if revision > self.revision:
                self.revision = revision
                self.first.set()

    def wait(self) -> None:
        if not self.first.wait(PATIENCE_S):
            raise TimeoutError("no picture")

    def time(self, message: Message) -> float:
        self.first.clear()
        start = time.perf_counter()
        self.session.ask(message)
        self.wait()
        return time.perf_counter() - start


def changes(n: int, medulla: bool) -> Iterator[tuple[str, Message]]:
    for i in range(n):
        yield "camera", Orbit(azimuth_deg=7.0, elevation_deg=0.0)
        yield "fibre", Set(key="fibre.beta_m_deg", value=5.0 + 0.1 * (i % 100))
        if medulla:
            yield "medulla", Set(key="fibre.kappa", value=0.4 + 0.001 * (i % 100))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=["black_hair", "red_fox"])
    parser.add_argument("--changes", type=int, default=20)
    given = parser.parse_args()
    print("scene       change    median s   95 % s   load   growth of memory MiB")
    for name in given.scenes:
        session = Session(load_scene(name, size="256x256"))
        try:
            clock = Clock(session)
            clock.wait()
            for _, message in changes(2, True):
                clock.time(message)
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            times: dict[str, list[float]] = {}
            for kind, message in changes(given.changes, True):
                times.setdefault(kind, []).append(clock.time(message))
            grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
            for kind, found in times.items():
                found.sort()
                high = found[min(int(0.95 * len(found)), len(found) - 1)]
                print(
                    f"{name:<11} {kind:<9} {statistics.median(found):8.3f} {high:8.3f} "
                    f"{os.getloadavg()[0]:6.1f} {grown:8.1f}"
                )
        finally:
            session.close()


if __name__ == "__main__":
    main()
