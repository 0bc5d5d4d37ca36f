"""How well machines share a render, simulated from measured times of parts.

python bench/stragglers.py -o bench/results/stragglers/portable [--device D] [SCENE]

Measures parts of a scene one after the other on this machine, then deals parts to machines as
`furcl.distributed` does: each takes the next when it is ready. A part's time is one of the measured
ones, times the pace of its machine. Some machines are slow, and one may be lost half-way. With
`again` a machine that has nothing left takes a part that another works on, and the first of both
counts.
"""

from __future__ import annotations

import argparse
import heapq
import time
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.distributed.parts import Part, render_part
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene

MACHINES = 100
SLOW, SLOWNESS = 0.05, 4.0  # share of machines that are slow, and by how much
SPREAD = 0.1  # standard deviation of the logarithm of the others' pace
PARTS_A_MACHINE = (1, 2, 4, 8, 16)
DRAWS = 200


def measured(scene_name: str, device: str | None, n: int) -> dict[str, Any]:
    """Seconds of parts and of the set-up, and bytes that are sent."""
    scene = load_scene(scene_name, spp=16, size=(128, 128))
    opened = open_device(device)
    start = time.perf_counter()
    renderer = Renderer(scene, opened)
    set_up = time.perf_counter() - start
    seconds = []
    for number in range(n + 1):
        start = time.perf_counter()
        image = render_part(renderer, Part(number, 0, 16 * number, 16))
        seconds.append(time.perf_counter() - start)
    assert image.variance is not None
    assert image.samples is not None
    grooms = scene.build_grooms().curves
    return {
        "seconds": seconds[1:],
        "set_up_seconds": set_up,
        "groom_bytes": grooms.points.nbytes + grooms.radii.nbytes + grooms.offsets.nbytes,
        "picture_bytes": image.rgb.nbytes + image.variance.nbytes + image.samples.nbytes,
        **circumstances(opened),
    }


def makespan(times: np.ndarray, pace: np.ndarray, again: bool, lost: int | None) -> float:
    """When the last part is there.

    Parameters
    ----------
    times : (parts,)        of each part on a machine of pace 1
    pace : (machines,)      factor on times
    again : bool            parts under way are taken by others at the end
    lost : int or None      machine that is lost with its second part, or its first
    """
    waiting = list(range(len(times)))[::-1]
    ready = [(0.0, machine) for machine in range(len(pace))]
    heapq.heapify(ready)
    ends = np.full(len(times), np.inf)
    taken = np.zeros(len(pace), int)
    while ready:
        now, machine = heapq.heappop(ready)
        if waiting:
            part = waiting.pop()
            if machine == lost and taken[machine] >= min(1, len(times) // len(pace) - 1):
                waiting.insert(0, part)  # found out at once, and another takes it
                continue
        elif again and (late := np.flatnonzero(ends > now)).size:
            part = late[np.argmax(ends[late])]
            if now + times[part] * pace[machine] >= ends[part]:
                continue
        else:
            continue
        taken[machine] += 1
        end = now + times[part] * pace[machine]
        ends[part] = min(ends[part], end)
        heapq.heappush(ready, (end, machine))
    return float(ends.max())


def simulated(seconds: np.ndarray, seed: int = 0) -> list[dict[str, Any]]:
    """Rows: what share of all machines' time is work, median and worst 5 % of the draws."""
    rows = []
    for parts_a_machine in PARTS_A_MACHINE:
        for lost, again in ((False, False), (False, True), (True, True)):
            rng = np.random.default_rng(seed)
            found = []
            for _ in range(DRAWS):
                pace = np.exp(SPREAD * rng.standard_normal(MACHINES))
                pace[rng.random(MACHINES) < SLOW] *= SLOWNESS
                # The work is the same however it is cut.
                times = rng.choice(seconds, MACHINES * parts_a_machine)
                times = times / times.sum() * MACHINES
                best = MACHINES / (1.0 / pace).sum()
                found.append(best / makespan(times, pace, again, 0 if lost else None))
            rows.append(
                {
                    "parts_a_machine": parts_a_machine, "again": again, "one_lost": lost,
                    "median": float(np.median(found)), "worst": float(np.quantile(found, 0.05)),
                }
            )  # fmt: skip
    return rows


def main() -> None:
    """Measure, simulate, write results.json and print the rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scene", nargs="?", default="black_hair")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--device")
    parser.add_argument("--parts", type=int, default=40, help="parts that are measured")
    given = parser.parse_args()
    found = measured(given.scene, given.device, given.parts)
    found["rows"] = simulated(np.array(found["seconds"]))
    write_json({"scene": given.scene, **found}, given.output / "results.json")
    for row in found["rows"]:
        print(row)


if __name__ == "__main__":
    main()
