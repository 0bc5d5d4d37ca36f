"""Tables of docs/performance.md that are made from bench/results/intersect.

`python bench/render_tables.py docs/performance.md` writes them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from results_tables import table

FOLDER = Path(__file__).parent / "results" / "intersect"
KINDS = ("primary", "bounce1", "bounce4", "shadow")
KIND_NAMES = ("primary", "bounce 1", "bounce 4, shuffled", "shadow")

Results = dict[str, Any]


def driver(device: dict[str, str]) -> str:
    """Runtime and version, short."""
    maker = device["platform"].split()[0].removesuffix("(R)")
    if maker == "Portable":
        return f"PoCL {device['driver'].partition('+')[0]}"
    return f"{maker} {'.'.join(device['driver'].split('.')[:2])}"


def row(results: Results) -> list[str]:
    """A groom's cells: million rays/s of furcl / of Embree = ratio (of processor seconds)."""
    rays = {rays["kind"]: rays for rays in results["rays"]}
    cells = []
    for kind in KINDS:
        r = rays[kind]
        cpu = "" if r["cpu_ratio"] is None else f" ({r['cpu_ratio']:.2f})"
        cells.append(f"{r['mrays_s']:.1f} / {r['embree_mrays_s']:.1f} = {r['ratio']:.2f}{cpu}")
    return [Path(results["groom"]).name, driver(results["device"]),
            f"{results['bytes_per_segment']:.0f}", *cells]  # fmt: skip


def falls(results: list[Results]) -> Iterator[list[str]]:
    """Of every generated groom and the one with ten times the segments: how often fewer rays/s."""
    by_name = {(driver(r["device"]), r["groom"]): r for r in results}
    for (runtime, name), small in by_name.items():
        large = by_name.get((runtime, f"{name}0"))
        if large and ":" in name:
            pairs = zip(small["rays"], large["rays"], strict=True)
            cells = [
                f"{few['mrays_s'] / many['mrays_s']:.1f} "
                f"({few['embree_mrays_s'] / many['embree_mrays_s']:.1f})"
                for few, many in pairs
            ]
            yield [f"{name}0", runtime, *cells]


def build(results: Results) -> list[str]:
    """A groom's cells: seconds, and memory [MB] as docs/performance.md explains it."""
    seconds, memory = results["build_seconds"], results["build_bytes"]
    per_million = seconds / results["segments"] * 1e6
    sizes = [results["groom_bytes"]]
    sizes += [memory[key] for key in ("device", "device_peak", "host_start", "host_peak")]
    sizes += [memory["host_peak"] - memory["host_start"] - memory["device_peak"]]
    numbers = [f"{seconds:.2f}", f"{per_million:.2f}", *(f"{n / 1e6:.0f}" for n in sizes)]
    return [results["groom"], driver(results["device"]), *numbers]


def found() -> list[Results]:
    """All results, in the order of the tables."""
    results = [json.loads(path.read_text()) for path in FOLDER.glob("*/results.json")]
    return sorted(
        results,
        key=lambda r: (driver(r["device"]), row(r)[0].rstrip("0123456789"), r["segments"]),
    )


def rays() -> str:
    """Rays a second beside Embree's."""
    return table(["groom", "driver", "B/segment", *KIND_NAMES], map(row, found()))


def tenfold() -> str:
    """What ten times the segments cost."""
    return table(["groom", "driver", *KIND_NAMES], falls(found()))


def builds() -> str:
    """Time and memory of building the trees of generated grooms."""
    columns = [
        "groom", "driver", "seconds", "for a million segments", "groom", "device",
        "device, while building", "process before", "process", "beyond",
    ]  # fmt: skip
    return table(columns, (build(r) for r in found() if ":" in r["groom"]))


TABLES = {"rays": rays, "tenfold": tenfold, "builds": builds}
