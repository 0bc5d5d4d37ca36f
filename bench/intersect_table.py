"""Print the tables of docs/performance.md from bench/results/intersect.

python bench/intersect_table.py
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "results" / "intersect"
KINDS = ("primary", "bounce1", "bounce4", "shadow")


def driver(device: dict[str, str]) -> str:
    """Runtime and version, short."""
    maker = device["platform"].split()[0].removesuffix("(R)")
    if maker == "Portable":
        return f"PoCL {device['driver'].partition('+')[0]}"
    return f"{maker} {'.'.join(device['driver'].split('.')[:2])}"


def row(results: dict[str, Any]) -> list[str]:
    """A groom's cells: million rays/s of furcl / of Embree = ratio (of processor seconds)."""
    rays = {rays["kind"]: rays for rays in results["rays"]}
    cells = []
    for kind in KINDS:
        r = rays[kind]
        cpu = "" if r["cpu_ratio"] is None else f" ({r['cpu_ratio']:.2f})"
        cells.append(f"{r['mrays_s']:.1f} / {r['embree_mrays_s']:.1f} = {r['ratio']:.2f}{cpu}")
    return [Path(results["groom"]).name, driver(results["device"]),
            f"{results['bytes_per_segment']:.0f}", *cells]  # fmt: skip


def falls(found: list[dict[str, Any]]) -> Iterator[list[str]]:
    """Of every generated groom and the one with ten times the segments: how often fewer rays/s."""
    by_name = {(driver(r["device"]), r["groom"]): r for r in found}
    for (runtime, name), small in by_name.items():
        kind, _, count = name.partition(":")
        large = by_name.get((runtime, f"{kind}:{count}0"))
        if large:
            cells = [
                f"{a['mrays_s'] / b['mrays_s']:.1f} ({a['embree_mrays_s'] / b['embree_mrays_s']:.1f})"
                for a, b in zip(small["rays"], large["rays"], strict=True)
            ]
            yield [f"{name}0", runtime, *cells]


def build(results: dict[str, Any]) -> list[str]:
    """A groom's cells: seconds, and memory [MB] as docs/performance.md explains it."""
    seconds, memory = results["build_seconds"], results["build_bytes"]
    beyond = memory["host_peak"] - memory["host_start"] - memory["device_peak"]
    sizes = (
        results["groom_bytes"], memory["device"], memory["device_peak"],
        memory["host_start"], memory["host_peak"], beyond,
    )  # fmt: skip
    return [results["groom"], driver(results["device"]), f"{seconds:.2f}",
            f"{seconds / results['segments'] * 1e6:.2f}", *(f"{n / 1e6:.0f}" for n in sizes)]  # fmt: skip


def main() -> None:
    found = [json.loads(path.read_text()) for path in FOLDER.glob("*/results.json")]
    found.sort(key=lambda r: (driver(r["device"]), row(r)[0].rstrip("0123456789"), r["segments"]))
    print("| groom | driver | B/segment | primary | bounce 1 | bounce 4, shuffled | shadow |")
    print("|---|---|---|---|---|---|---|")
    for results in found:
        print(f"| {' | '.join(row(results))} |")
    print()
    print("| groom | driver | primary | bounce 1 | bounce 4, shuffled | shadow |")
    print("|---|---|---|---|---|---|")
    for cells in falls(found):
        print(f"| {' | '.join(cells)} |")
    print()
    print("| groom | driver | seconds | for a million segments | groom | device | device, while building "
          "| process before | process | beyond |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    for results in found:
        if ":" in results["groom"]:
            print(f"| {' | '.join(build(results))} |")


if __name__ == "__main__":
    main()
