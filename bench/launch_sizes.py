"""Rays a second of small launches over those of the largest.

python bench/launch_sizes.py [GROOM...] [-o FILE] [--device DEVICE] [--rounds 15]

The rays of `furcl bench intersect`, in pieces of 4, 16 and 64 thousand, as those that late bounces
launch. Pieces of every size are spread evenly over the same rays, so all have the same to do on
average; each is launched when the one before has ended. Sizes take turns.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.intersect import groom_and_camera
from furcl.bench.ray_sets import RaySet, ray_sets
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.oracle.embree_rays import EmbreeScene
from furcl.rendering.rays import Rays, Tracer

GROOMS = ("hair:150000", "fur:700000")
SIZES = (1 << 12, 1 << 14, 1 << 16)
MOST_PIECES = 32
#: Width and height of the picture that the primary rays make: a million of them.
PICTURE = 1024


def pieces(tracer: Tracer, rays: RaySet, size: int) -> list[Rays]:
    """Rays of a set in pieces of a size, on the device."""
    n = len(rays.origins)
    count = max(1, min(n // size, MOST_PIECES))
    return [
        Rays(tracer.memory, rays.origins[part, :3], rays.directions[part, :3],
             rays.directions[part, 3])
        for part in (slice(i, i + size) for i in np.linspace(0, n - size, count).astype(int))
    ]  # fmt: skip


def measure(tracer: Tracer, rays: RaySet, rounds: int) -> dict[str, Any]:
    """Million rays/s of launches of each size and of all rays at once; medians of the ratios."""
    trace = tracer.shadow if rays.any_hit else tracer.closest
    sizes = [*(size for size in SIZES if size < len(rays.origins)), len(rays.origins)]
    launches = {size: pieces(tracer, rays, size) for size in sizes}
    speeds = np.empty((rounds + 1, len(sizes)))
    for turn in speeds:
        for i, size in enumerate(sizes):
            start = time.perf_counter()
            for piece in launches[size]:
                trace(piece).wait()
            turn[i] = size * len(launches[size]) / (time.perf_counter() - start)
    speeds = speeds[1:]  # in the first one kernels may be compiled for a size
    return {
        "kind": rays.name,
        "sizes": sizes,
        "mrays_s": (np.median(speeds, axis=0) / 1e6).tolist(),
        "over_largest": np.median(speeds / speeds[:, -1:], axis=0).tolist(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("grooms", nargs="*", default=GROOMS)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/launch_sizes.json"))
    parser.add_argument("--device")
    parser.add_argument("--rounds", type=int, default=15)
    given = parser.parse_args()
    device = open_device(given.device)
    rows = []
    for name in given.grooms:
        curves, camera = groom_and_camera(name)
        tracer = Tracer(device, curves, not curves.one_radius)
        for rays in ray_sets(curves, camera, PICTURE, EmbreeScene(curves), 1):
            row = {"groom": name, **measure(tracer, rays, given.rounds)}
            print(name, row["kind"], *map("{:.2f}".format, row["over_largest"]), flush=True)
            rows.append(row)
    write_json({**circumstances(device), "rounds": given.rounds, "rows": rows}, given.output)


if __name__ == "__main__":
    main()
