"""What motion blur costs: memory, build time and rays a second of a groom that moves, beside those
of the same groom standing still.

python bench/motion_blur.py [GROOM] [--shifts 0.01,0.1,0.5] [--pieces 1,4,16] [--size 256]
    [--rounds 5] [--device TEXT] [-o FILE.json]

GROOM is what `furcl bench intersect` takes. While the shutter is open the groom goes a part of its
size (a shift) across the view and bends: tips stay behind by a third of the way. Its time steps cut
that into pieces, each with a tree. Every ray has a random time. Rays a second are medians over
rounds in which all take turns, `of still` the medians of the rounds' ratios of processor seconds a
ray, with 95 % intervals; primary rays and shadow rays, from where those hit towards a light, count
together.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.intersect import groom_and_camera
from furcl.bench.pairs import in_turns, median_interval
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.device.layout import NO_SEGMENT
from furcl.groom.curves import Curves
from furcl.rendering.rays import Rays, Tracer
from furcl.scene.camera import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """How far a groom goes, in parts of its size, and in how many pieces of time."""

    shift: float
    pieces: int


def moving(curves: Curves, camera: Camera, motion: Motion) -> Curves:
    """A groom that goes to the right and bends."""
    if not motion.pieces:
        return curves
    lo, hi = curves.bounds()
    way = motion.shift * float((hi - lo).max()) * camera.frame()[1]
    counts = np.diff(curves.offsets)
    place = np.arange(curves.n_points) - np.repeat(curves.offsets[:-1], counts)
    along = place / np.repeat(counts - 1, counts)
    steps = []
    for part in np.linspace(-0.5, 0.5, motion.pieces + 1):
        # The tips' lag is largest in the middle of the way.
        behind = (0.25 - part * part) / 0.75 * along
        steps.append((curves.points + (part - behind)[:, None] * way).astype(np.float32))
    return Curves.from_arrays(np.stack(steps), curves.radii, curves.offsets)


class Subject:
    """A groom on the device, with rays of random times that meet it."""

    def __init__(
        self, device: Device, curves: Curves, camera: Camera, motion: Motion, size: int
    ) -> None:
        self.motion = motion
        groom = moving(curves, camera, motion)
        self.tracer = Tracer(device, groom, groom.steps is not None or not groom.one_radius)
        rng = np.random.default_rng(1)
        x, y = (v.ravel() for v in np.meshgrid(*2 * [np.arange(size)], indexing="xy"))
        film = (np.stack([x, y]) + rng.random((2, size * size))) / size
        origins, directions = camera.rays(*film)
        times = (motion.pieces * rng.random(size * size)).astype(np.float32)
        self.primary = self._rays(origins, directions, times)
        self.tracer.closest(self.primary)
        t, segment, _ = self.tracer.hits(self.primary)
        hit = segment != NO_SEGMENT
        lo, hi = curves.bounds()
        at = origins[hit] + t[hit, None] * directions[hit]
        to = 0.5 * (lo + hi) + (hi - lo).max() * np.array([-0.8, -0.8, 1.2]) - at
        way = to / np.linalg.norm(to, axis=1, keepdims=True)
        skip = 4.0 * float(curves.radii.max())
        self.shadow = self._rays(at + skip * way, way, times[hit])
        self.hits = float(hit.mean())

    def _rays(self, origins: Array, directions: Array, times: NDArray[np.float32]) -> Rays:
        arrays = (np.asarray(v, np.float32) for v in (origins, directions))
        return Rays(self.tracer.memory, *arrays, times=times)

    @property
    def n_rays(self) -> int:
        """Primary and shadow rays."""
        return self.primary.n + self.shadow.n

    def action(self) -> Callable[[], None]:
        """Trace them all."""

        def trace() -> None:
            self.tracer.closest(self.primary)
            self.tracer.shadow(self.shadow)
            self.tracer.device.queue.finish()

        return trace


def measure(
    device: Device, name: str, motions: list[Motion], size: int, rounds: int
) -> list[dict[str, Any]]:
    """A row for each motion; the first is none."""
    curves, camera = groom_and_camera(name)
    subjects = [Subject(device, curves, camera, motion, size) for motion in motions]
    for subject in subjects:
        subject.action()()  # runtimes finish compiling at the first launch
    seconds = in_turns({i: s.action() for i, s in enumerate(subjects)}, rounds)
    still = subjects[0].n_rays / seconds[0].cpu
    rows = []
    for i, subject in enumerate(subjects):
        rates = subject.n_rays / seconds[i].wall
        ratio = median_interval(subject.n_rays / seconds[i].cpu / still)
        tree = subject.tracer.bvh
        rows.append(
            {
                **asdict(subject.motion),
                "segments": tree.n_segments,
                "hits": subject.hits,
                "vertex_bytes": tree.vertices.size,
                "tree_bytes": tree.blocks.size,
                "build_seconds": tree.build_seconds,
                "rays_per_second": float(np.median(rates)),
                "of_still": asdict(ratio),
            }
        )
    return rows


def shown(row: dict[str, Any]) -> str:
    """A row of the table."""
    ratio = row["of_still"]
    ends = "" if ratio["low"] is None else f" [{ratio['low']:.2f}, {ratio['high']:.2f}]"
    n, mib = row["segments"], 2.0**20
    vertices, tree = row["vertex_bytes"], row["tree_bytes"]
    return (
        f"| {row['shift']:g} | {row['pieces'] or 'still'} | {vertices / mib:.1f} | "
        f"{tree / mib:.1f} | {(vertices + tree) / n:.0f} | {row['build_seconds']:.2f} | "
        f"{row['hits']:.2f} | {row['rays_per_second'] / 1e6:.2f} | {ratio['median']:.2f}{ends} |"
    )


def main(words: list[str]) -> None:
    """Measure, print a table, and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("groom", nargs="?", default="fur:200000")
    parser.add_argument("--shifts", default="0.01,0.1,0.5")
    parser.add_argument("--pieces", default="1,4,16")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--device")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args(words)
    device = open_device(options.device)
    motions = [Motion(0.0, 0)] + [
        Motion(float(shift), int(pieces))
        for shift in options.shifts.split(",")
        for pieces in options.pieces.split(",")
    ]
    rows = measure(device, options.groom, motions, options.size, options.rounds)
    print(
        "| shift | pieces | vertices, MiB | tree, MiB | bytes a segment | build, s | hits | "
        "Mrays/s | of still |\n|" + " ---: |" * 9
    )
    for row in rows:
        print(shown(row))
    if options.output:
        facts = {"groom": options.groom, "size": options.size, "rounds": options.rounds}
        write_json({**circumstances(device), **facts, "rows": rows}, options.output)


if __name__ == "__main__":
    main(sys.argv[1:])
