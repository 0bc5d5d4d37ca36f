"""Tables of docs/performance.md about rays and trees: bench/results/intersect."""

from __future__ import annotations

from pathlib import Path

from launch_sizes import SIZES
from tables import Results, circumstances, driver, load, runs, table

LAUNCHES = "launch_sizes.json"
KINDS = ("primary", "bounce1", "bounce4", "shadow")
KIND_NAMES = ("primary", "bounce 1", "bounce 4, shuffled", "shadow")


def found() -> list[Results]:
    """All results, in the order of the tables."""
    results = runs("intersect")
    return sorted(
        results,
        key=lambda r: (driver(r), Path(r["groom"]).name.rstrip("0123456789"), r["segments"]),
    )


def row(results: Results) -> list[str]:
    """A groom's cells: million rays/s of furcl / of Embree = ratio (of processor seconds)."""
    rays = {rays["kind"]: rays for rays in results["rays"]}
    cells = []
    for kind in KINDS:
        r = rays[kind]
        cpu = "" if r["cpu_ratio"] is None else f" ({r['cpu_ratio']:.2f})"
        cells.append(f"{r['mrays_s']:.1f} / {r['embree_mrays_s']:.1f} = {r['ratio']:.2f}{cpu}")
    return [Path(results["groom"]).name, driver(results), f"{results['segments']}",
            f"{results['bytes_per_segment']:.0f}", *cells]  # fmt: skip


def rays() -> str:
    """Rays a second beside Embree's, and on how many rays the two differ."""
    results = found()
    worst = max(rays["disagreements"] for r in results for rays in r["rays"])
    columns = ["groom", "driver", "segments", "B/segment", *KIND_NAMES]
    return (
        f"{table(columns, map(row, results))}\n\n"
        f"The two find different things on at most {1e5 * worst:.0f} rays in 100 000."
    )


def build(results: Results) -> list[str]:
    """A groom's cells: seconds, and memory [MB] as docs/performance.md explains it."""
    seconds, memory = results["build_seconds"], results["build_bytes"]
    per_million = seconds / results["segments"] * 1e6
    sizes = [results["groom_bytes"]]
    sizes += [memory[key] for key in ("device", "device_peak", "host_start", "host_peak")]
    sizes += [memory["host_peak"] - memory["host_start"] - memory["device_peak"]]
    numbers = [f"{seconds:.2f}", f"{per_million:.2f}", *(f"{n / 1e6:.0f}" for n in sizes)]
    return [results["groom"], driver(results), *numbers]


def builds() -> str:
    """Time and memory of building the trees of generated grooms."""
    columns = [
        "groom", "driver", "seconds", "for a million segments", "groom", "device",
        "device, while building", "process before", "process", "beyond",
    ]  # fmt: skip
    return table(columns, (build(r) for r in found() if ":" in r["groom"]))


def launch_sizes() -> str:
    """Rays a second of launches of each size over those of the largest."""
    results = load(LAUNCHES)
    columns = ["groom", "rays", *(f"{size >> 10} k" for size in SIZES), "all, million rays/s"]
    rows = []
    for row in results["rows"]:
        of_size = dict(zip(row["sizes"], row["over_largest"], strict=True))
        cells = [f"{of_size[size]:.2f}" if size in of_size else "" for size in SIZES]
        rows.append([row["groom"], row["kind"], *cells, f"{row['mrays_s'][-1]:.1f}"])
    return table(columns, rows)


TABLES = {
    "launch-sizes": launch_sizes,
    "launch-sizes-circumstances": lambda: circumstances(load(LAUNCHES)),
    "rays": rays,
    "rays-circumstances": lambda: circumstances(*found()),
    "builds": builds,
}
