"""Write the tables of docs/performance.md, between their markers.

python bench/render_tables.py docs/performance.md

They are made from bench/results/stages, waves, peers, start and features, where every folder is a
run, and those of rays by intersect_table.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import intersect_table
from results_tables import filled, table

FOLDER = Path(__file__).parent / "results"

# M paths/s on hair10k and fur100k: 128 x 128, 16 bounces, no roulette, constant environment and a
# square light, diffuse scalp; AMD Zen 5 virtual machine, 2 cores, no GPU.
PEERS = {
    "Mitsuba 3.9.1 llvm_ad_rgb, linearcurve": ("0.28-0.31", "0.27"),
    "Mitsuba 3.9.1 llvm_ad_rgb, bsplinecurve": ("0.25-0.28", "0.20"),
    "Mitsuba 3.9.1 scalar_rgb, bsplinecurve": ("0.15", "0.12"),
    "Cycles (bpy 4.5) ribbons, Chiang": ("0.16-0.18", "0.12"),
    "Cycles (bpy 4.5) thick curves, Chiang": ("0.12", "0.08"),
    "Cycles (bpy 4.5) ribbons, Huang": ("0.08-0.09", "0.07"),
    "LuxCore 2.11 PATHCPU, ribbons as triangles": ("0.25-0.40", "0.31-0.34"),
}


def runs(kind: str) -> Iterator[dict[str, Any]]:
    """The results of one benchmark, device by device."""
    for path in sorted((FOLDER / kind).glob("*/results.json")):
        yield json.loads(path.read_text())


def driver(results: dict[str, Any]) -> str:
    """The device in few words."""
    device = results["device"]
    return f"{device['platform'].split(' OpenCL')[0]} {device['driver']}"


def circumstances(kind: str) -> str:
    """Machine, commit and command of every run of a benchmark."""
    lines = []
    for found in runs(kind):
        machine = found["machine"]
        commit = f", commit {found['git']}" if "git" in found else ""
        lines.append(
            f"{driver(found)} on {machine['processor']}, {machine['cores']} cores, "
            f"{found['date']}{commit}:\n\n    {found['command']}\n"
        )
    return "\n".join(lines).rstrip()


def end_to_end() -> str:
    """Whole renders beside the intersect kernels on the same rays."""
    rows = [
        [
            driver(found),
            row["scene"],
            "x".join(map(str, row["size"])) + f", {found['spp']} spp",
            str(row["wave_size"]),
            f"{row['mpaths_s']:.3f}",
            f"{row['mrays_s']:.2f}",
            f"{row['intersect_mrays_s']:.2f}",
            f"{row['end_to_end']:.0%}",
            f"{row['launch_overhead']:.1%}",
        ]
        for found in runs("stages")
        for row in found["scenes"]
    ]
    columns = ["device", "scene", "picture", "wave", "M paths/s", "M rays/s"]
    return table([*columns, "intersect alone, M rays/s", "end to end", "no kernel runs"], rows)


def stages() -> str:
    """Share of every kernel in the time of all kernels, and its rate."""
    rows = []
    for found in runs("stages"):
        for scene in found["scenes"]:
            for row in scene["stages"]:
                rows.append(
                    [
                        driver(found),
                        scene["scene"],
                        row["stage"],
                        f"{row['share']:.1%}",
                        f"{row['million_per_second']:.1f} {row['counts'].replace('_', ' ')}",
                        str(row["bytes_per_item"]),
                        f"{row['gb_per_second']:.2f}",
                    ]
                )
    columns = ["device", "scene", "kernel", "share", "million/s", "bytes each", "GB/s"]
    return table(columns, rows)


def waves() -> str:
    """Speed by the size of waves, over that of the first size."""
    rows = []
    for found in runs("waves"):
        for scene in found["scenes"]:
            sizes = [f"{row['size']}: {row['ratio']:.3f}" for row in scene["rows"]]
            rows.append([driver(found), scene["scene"], str(scene["chosen"]), ", ".join(sizes)])
    return table(["device", "scene", "chosen", "times faster than the first, by size"], rows)


def peers() -> str:
    """Paths a second on the peers' grooms, beside the peers'."""
    rows = [[name, "", *figures] for name, figures in PEERS.items()]
    for found in runs("peers"):
        for kind in ("bcsdf", "mis"):
            here = {r["scene"]: r for r in found["rows"] if r["light_sampling"] == kind}
            rows.append(
                [
                    f"furcl, {driver(found)}",
                    kind,
                    *(
                        f"{here[groom]['mpaths_s']:.2f} ({here[groom]['mrays_s']:.2f} M rays/s)"
                        for groom in ("hair10k", "fur100k")
                    ),
                ]
            )
    columns = ["renderer", "light sampling", "hair10k, M paths/s", "fur100k, M paths/s"]
    return table(columns, rows)


def start() -> str:
    """Seconds from the command to the first samples."""
    rows = []
    for found in runs("start"):
        cold = ", ".join(
            f"{name} {seconds:.2f}" for name, seconds in found["cold"]["parts"].items()
        )
        warm = [run["first_samples"] for run in found["warm"]]
        rows.append(
            [
                driver(found),
                f"{found['scene']}, {found['size']}",
                f"{found['cold']['first_samples']:.1f} ({cold})",
                f"{found['warm_median']:.2f} ({min(warm):.2f} to {max(warm):.2f})",
                f"{found['import_seconds']:.3f}",
                f"{found['compile_everything_seconds']:.1f}",
            ]
        )
    columns = ["device", "scene", "caches empty, s (parts)", "caches full, s", "import furcl, s"]
    return table([*columns, "largest variant, s to compile"], rows)


def features() -> str:
    """What the specialised build buys over the one with everything on."""
    rows = []
    for found in runs("features"):
        for row in found["scenes"]:
            lean, full = (row["builds"][name] for name in ("specialised", "everything-on"))
            same = "equal bits" if row["pictures"]["equal"] else f"z = {row['pictures']['z']:.2f}"
            rows.append(
                [
                    driver(found),
                    row["scene"] + (" *" if "--set" in found["command"] else ""),
                    f"{row['time_ratio']:.2f}",
                    (
                        f"{lean['state_and_table_bytes'] / 2**20:.1f} of "
                        f"{full['state_and_table_bytes'] / 2**20:.1f}"
                    ),
                    f"{lean['source_bytes'] / 1000:.0f} of {full['source_bytes'] / 1000:.0f}",
                    same,
                    ", ".join(row["left_out"]),
                ]
            )
    columns = ["device", "scene", "times faster", "MiB of state and tables", "kB of source"]
    return table([*columns, "pictures", "left out"], rows)


TABLES = {
    **intersect_table.TABLES,
    "start-circumstances": lambda: circumstances("start"),
    "start": start,
    "features-circumstances": lambda: circumstances("features"),
    "features": features,
    "stages-circumstances": lambda: circumstances("stages"),
    "end-to-end": end_to_end,
    "stages": stages,
    "waves-circumstances": lambda: circumstances("waves"),
    "waves": waves,
    "peers-circumstances": lambda: circumstances("peers"),
    "peers": peers,
}


if __name__ == "__main__":
    document = Path(sys.argv[1])
    document.write_text(filled(document.read_text(), TABLES))
