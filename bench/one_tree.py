"""One tree over all grooms of a scene, or a tree each: which finds hits faster.

python bench/one_tree.py [SCENE] [--size 512] [--rounds 15] [--device TEXT] [-o FILE.json]

The rays are those of `furcl bench intersect`. Through a tree each they go one groom after the
other, each search ending at the nearest hit of those before; shadow rays that are stopped end
there. `one over each` is how many times as many rays a processor second one tree traces, the median
of rounds in which both take turns with its 95 % interval. The hits of both are compared.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.pairs import in_turns, median_interval
from furcl.bench.ray_sets import RaySet, ray_sets
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.oracle.embree_rays import EmbreeScene
from furcl.rendering.rays import Rays, Tracer
from furcl.scene.read import find_scene, load_scene


def one_after_the_other(tracers: Sequence[Tracer], rays: RaySet) -> tuple[list[Rays], np.ndarray]:
    """The rays of each tracer's search, on its device, and what all found together: nearest
    distances (n,) float32, of shadow rays whether they are stopped (n,)."""
    origins, directions = rays.origins[:, :3], rays.directions[:, :3]
    reach = rays.directions[:, 3].copy()
    stopped = np.zeros(len(reach), bool)
    searches = []
    for tracer in tracers:
        left = ~stopped
        search = Rays(tracer.memory, origins[left], directions[left], reach[left])
        searches.append(search)
        if rays.any_hit:
            tracer.shadow(search)
            stopped[left] = tracer.occluded(search)
        else:
            tracer.closest(search)
            reach = tracer.hits(search)[0]
    return searches, stopped if rays.any_hit else reach


def compare(joined: Tracer, tracers: Sequence[Tracer], rays: RaySet, rounds: int) -> dict[str, Any]:
    """Time one kind of rays."""
    at_once, together = one_after_the_other([joined], rays)
    searches, apart = one_after_the_other(tracers, rays)

    def trace(pairs: Sequence[tuple[Tracer, Rays]]) -> None:
        for tracer, search in pairs:
            (tracer.shadow if rays.any_hit else tracer.closest)(search).wait()

    seconds = in_turns(
        {
            "one": lambda: trace([(joined, at_once[0])]),
            "each": lambda: trace(list(zip(tracers, searches, strict=True))),
        },
        rounds,
    )
    ratio = median_interval(seconds["each"].cpu / seconds["one"].cpu)
    return {
        "kind": rays.name,
        "n": len(rays.origins),
        "one_over_each": [ratio.median, ratio.low, ratio.high],
        "differ": float(np.mean(together != apart)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="two_grooms")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--device")
    parser.add_argument("-o", "--output", type=Path)
    args = parser.parse_args()
    scene = load_scene(find_scene(args.scene))
    grooms = scene.build_grooms()
    if len(grooms.grooms) < 2:
        sys.exit(f"{args.scene}: has one groom; give a scene of several")
    curves = grooms.curves
    device = open_device(args.device)
    joined = Tracer(device, curves, not curves.one_radius)
    tracers = [Tracer(device, groom.curves, not groom.curves.one_radius) for groom in grooms.grooms]
    embree = EmbreeScene(curves, None)
    rows = [
        compare(joined, tracers, rays, args.rounds)
        for rays in ray_sets(curves, scene.resolved_camera(curves), args.size, embree, seed=1)
    ]
    print(f"{args.scene}: {' + '.join(str(g.curves.n_segments) for g in grooms.grooms)} segments")
    print("| rays | number | one over each | hits that differ |")
    print("|---|---:|---:|---:|")
    for row in rows:
        median, low, high = row["one_over_each"]
        ratio = f"{median:.2f} [{low:.2f}, {high:.2f}]"
        print(f"| {row['kind']} | {row['n']} | {ratio} | {row['differ']:.1e} |")
    if args.output:
        record = {**circumstances(device), "scene": args.scene, "size": args.size, "rays": rows}
        write_json(record, args.output)


if __name__ == "__main__":
    main()
