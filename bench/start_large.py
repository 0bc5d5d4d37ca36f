"""What a large groom takes from its file to the first sample: seconds and memory, stage by stage.

python bench/start_large.py [-o FOLDER] [--groom head:10000000] [--formats hair,npz,usdc] [--runs 3]
                            [--device DEVICE] [--size 512]

A generated groom (names as for `furcl bench intersect`) is written in each format. A process of its
own then opens the device and renders a small groom, so that what follows is of the large one alone:
it reads the file, sets the scene up and renders a sample a pixel. A first run, not counted,
compiles what is missing. Seconds and memory are medians of the runs. Memory is the most that the
process holds during a stage, with the device's buffers on CPU devices, and the most that a
process held which it started: files of USD are read by one.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from furcl.bench.intersect import groom_and_camera
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves
from furcl.groom.grow import GENERATORS
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene


class Stages:
    """Seconds, and the most memory that is held [bytes], of one stage after the other."""

    def __init__(self) -> None:
        self.found: dict[str, dict[str, Any]] = {}
        self._begin()

    def _begin(self) -> None:
        Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")  # VmHWM is VmRSS again
        self._start = time.perf_counter()

    def end(self, name: str, **facts: Any) -> None:
        """End the stage that began when the last one ended."""
        seconds = time.perf_counter() - self._start
        status = Path("/proc/self/status").read_text(encoding="utf-8")
        kib = dict(re.findall(r"^(VmHWM|VmRSS):\s*(\d+) kB$", status, re.MULTILINE))
        self.found[name] = {
            "seconds": seconds,
            "peak_bytes": 1024 * int(kib["VmHWM"]),
            "end_bytes": 1024 * int(kib["VmRSS"]),
            "children_peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss,
            **facts,
        }
        self._begin()


def one_run(path: Path, device: str | None, size: int) -> dict[str, Any]:
    """The stages of one start, in this process."""
    stages = Stages()
    opened = open_device(device)
    scene = load_scene(
        "groom", overrides=[f"curves.file={json.dumps(str(path))}"], size=(size, size), spp=1
    )
    small = Renderer(scene, opened, curves=GENERATORS["hair"](n_strands=1000))
    small.advance(1)
    del small
    stages.end("before")
    curves = load_curves(path)
    stages.end("read", bytes=curves.n_bytes, segments=curves.n_segments)
    renderer = Renderer(scene, opened, curves=curves)
    stages.end("set up", parts=dict(renderer.seconds), bytes=renderer.memory.total_bytes,
               device_peak_bytes=renderer.memory.peak_bytes)  # fmt: skip
    renderer.advance(1)
    stages.end("first sample")
    return stages.found


def median(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Stage by stage the medians of all numbers."""
    return {
        key: median([run[key] for run in runs])
        if isinstance(value, dict)
        else statistics.median(run[key] for run in runs)
        for key, value in runs[0].items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/start_large"))
    parser.add_argument("--groom", default="head:10000000")
    parser.add_argument("--formats", default="hair,npz,usdc")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--device")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(one_run(given.one, given.device, given.size)))
        return
    grown, _ = groom_and_camera(given.groom)
    # What grew it is left out, which not all formats have a place for.
    curves = Curves.from_arrays(grown.points, grown.radii, grown.offsets)
    files = {}
    with tempfile.TemporaryDirectory() as folder:
        for suffix in given.formats.split(","):
            path = Path(folder) / f"groom.{suffix}"
            save_curves(curves, path)
            command = [sys.executable, os.fspath(Path(__file__).resolve()), "--one", str(path),
                       "--size", str(given.size)]  # fmt: skip
            command += ["--device", given.device] if given.device else []
            runs = []
            for _ in range(1 + given.runs):
                done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
                runs.append(json.loads(done.stdout.splitlines()[-1]))
            files[suffix] = {"bytes": path.stat().st_size, "stages": median(runs[1:])}
            print(suffix, *(f"{n} {s['seconds']:.2f} s {s['peak_bytes'] / 1e6:.0f} MB"
                            for n, s in files[suffix]["stages"].items()), sep="; ")  # fmt: skip
            path.unlink()
    results = {
        **circumstances(open_device(given.device)),
        "groom": given.groom,
        "strands": curves.n_strands,
        "segments": curves.n_segments,
        "runs": given.runs,
        "files": files,
    }
    write_json(results, given.output / "results.json")


if __name__ == "__main__":
    main()
