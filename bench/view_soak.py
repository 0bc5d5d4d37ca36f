"""Whether many changes in the live view leave anything behind: memory, threads, files.

python bench/view_soak.py [SCENE] [--changes 1000] [--size 32x32] [--strands 500] [--device TEXT]

Changes of all kinds of bench/view_latency.py, one after the other. Printed every tenth of the way
are the process's memory, that on the device, threads, open files, files in the folder for temporary
ones (a fresh one) and those in the cache, whose number furcl.cache limits. Ends with 1 if there are
more threads, files or bytes on the device at the end than after the second tenth, or if the median
of the memory in the second half is above that in the first by more than GROWTH.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from view_latency import CHANGES, NO_SAMPLE, Clock

from furcl.paths import cache_folder
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene
from furcl.viewer.session import Session

#: Memory may grow by this part of what it was: allocators keep what was given back, and it goes up
#: and down by 5 % from tenth to tenth.
GROWTH = 0.05
NAMES = ("memory MiB", "device MiB", "threads", "open files", "temporary", "cached")


def files_in(folder: Path) -> int:
    return sum(path.is_file() for path in folder.rglob("*"))


def held(session: Session) -> tuple[float, ...]:
    """What the process holds, in the order of NAMES."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    renderer = session._progressive._follower.renderer
    assert renderer is not None
    return (
        pages * os.sysconf("SC_PAGE_SIZE") / 2**20,
        renderer.memory.total_bytes / 2**20,
        threading.active_count(),
        len(list(Path("/proc/self/fd").iterdir())),
        files_in(Path(tempfile.gettempdir())),
        files_in(cache_folder()),
    )


def soaked(scene: Scene, changes: int, device: str | None) -> Iterator[tuple[float, ...]]:
    """What is held at the start and after every tenth of the changes."""
    session = Session(scene, device)
    try:
        clock = Clock(session)
        clock.wait(clock.picture)
        yield held(session)
        kinds = list(CHANGES)
        for i in range(changes):
            kind = kinds[i % len(kinds)]
            clock.time(CHANGES[kind](i // len(kinds)), of_picture=kind not in NO_SAMPLE)
            if (i + 1) % max(changes // 10, 1) == 0:
                yield held(session)
    finally:
        session.close()


def grown(rows: list[tuple[float, ...]]) -> list[str]:
    """What there is more of at the end: memory, or something but cached files."""
    first, last = np.array(rows[min(2, len(rows) - 1)]), np.array(rows[-1])
    half = len(rows) // 2
    memory = np.array([row[0] for row in rows])
    first[0], last[0] = np.median(memory[2:half]) * (1.0 + GROWTH), np.median(memory[half:])
    return [name for name, a, b in zip(NAMES[:-1], first, last, strict=False) if b > a + 1e-2]


def main() -> int:
    """Print what is held; 1 if something grows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scene", nargs="?", default="black_hair")
    parser.add_argument("--changes", type=int, default=1000)
    parser.add_argument("--size", default="32x32")
    parser.add_argument("--strands", type=int, default=500)
    parser.add_argument("--device")
    given = parser.parse_args()
    strands = [f"curves.n_strands={given.strands}"]
    scene = load_scene(given.scene, overrides=strands, size=given.size)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        tempfile.tempdir = folder
        print("  ".join(["part", *NAMES]))
        for row in soaked(scene, given.changes, given.device):
            print(f"{len(rows):4}  " + "  ".join(f"{value:10.6g}" for value in row), flush=True)
            rows.append(row)
    found = grown(rows)
    print(f"grown: {', '.join(found) or 'nothing'}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
