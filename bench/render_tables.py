"""Tables of docs/performance.md about whole renders: bench/results/stages, peers, peer_causes,
start, features and medulla_tables.json.
"""

from __future__ import annotations

from typing import Any

from tables import circumstances, driver, load, runs, table

LARGE = "start_large/results.json"
CAUSES = "peer_causes/results.json"


def end_to_end() -> str:
    """Whole renders beside the intersect kernels on the same rays."""
    rows = [
        [
            driver(found),
            row["scene"],
            "x".join(map(str, row["size"])) + f", {found['spp']} spp",
            f"{row['mpaths_s']:.3f}",
            f"{row['mrays_s']:.2f}",
            f"{row['intersect_mrays_s']:.2f}",
            f"{row['end_to_end']:.0%}",
            f"{row['launch_overhead']:.1%}",
            _cores(row, found),
        ]
        for found in runs("stages")
        for row in found["scenes"]
    ]
    columns = ["device", "scene", "picture", "M paths/s", "M rays/s"]
    columns += ["intersect alone, M rays/s", "end to end", "no kernel runs", "cores busy"]
    return table(columns, rows)


def _cores(row: dict[str, Any], found: dict[str, Any]) -> str:
    busy = row.get("cores_busy")
    return "" if busy is None else f"{busy:.2f} of {found['machine']['cores']}"


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
                    ]
                )
    return table(["device", "scene", "kernel", "share", "million/s"], rows)


def peers() -> str:
    """Other renderers beside furcl: time to the same error, paths a second, radiance."""
    rows = []
    for found in runs("peers"):
        for row in found["rows"]:
            ratio, bright = row.get("furcl_over_it"), row.get("radiance_over_furcl")
            rows.append(
                [
                    row["groom"],
                    row["settings"],
                    row["version"] if ratio else f"furcl, {driver(found)}",
                    f"{row['mpaths_s']:.3f}",
                    number_in(ratio) if ratio else "1",
                    number_in(bright) if bright else "1",
                ]
            )
    columns = ["groom", "settings", "renderer", "M paths/s", "furcl's efficiency over its"]
    return table([*columns, "radiance over furcl's"], rows)


def number_in(interval: list[float]) -> str:
    """A ratio with its interval."""
    ratio, low, high = interval
    return f"{ratio:.3g} [{low:.3g}, {high:.3g}]"


def peer_causes() -> str:
    """A scene a row, changed as it says; the mean radiance of others over furcl's."""
    columns = {
        ("mitsuba-llvm", ""): "Mitsuba",
        ("mitsuba-llvm", "fibre"): "Mitsuba, the other tilt",
        ("cycles", ""): "Cycles",
        ("furcl", "mode"): "furcl, near field",
    }
    cells: dict[str, dict[str, str]] = {}
    for row in load(CAUSES)["rows"]:
        column = columns[row["renderer"], "".join(row["changes"])]
        cells.setdefault(row["case"], {})[column] = (
            f"{row['over_furcl']:.3f} +- {row['standard_error']:.3f}"
        )
    names = list(columns.values())
    return table(
        ["scene", *names], [[case, *(of.get(n, "") for n in names)] for case, of in cells.items()]
    )


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


def start_large() -> str:
    """Seconds and memory [MB] of each stage between the file of a large groom and a sample."""
    found = load(LARGE)
    rows = []
    for suffix, file in found["files"].items():
        stages = file["stages"]
        cells = [f"{stages['before']['end_bytes'] / 1e6:.0f}"]
        for name in ("read", "set up", "first sample"):
            cells += [f"{stages[name]['seconds']:.1f}", f"{stages[name]['peak_bytes'] / 1e6:.0f}"]
        read, before = (stages[name]["children_peak_bytes"] for name in ("read", "before"))
        cells[2] += f" and {read / 1e6:.0f}" if read > before else ""
        parts = stages["set up"]["parts"]
        cells[3] += f" ({', '.join(f'{name} {seconds:.1f}' for name, seconds in parts.items())})"
        device = stages["set up"]
        cells += [f"{device['bytes'] / 1e6:.0f}", f"{device['device_peak_bytes'] / 1e6:.0f}"]
        rows.append([f".{suffix}", f"{file['bytes'] / 1e6:.0f}", *cells])
    columns = ["file", "MB", "before, MB", "read, s", "MB", "set up, s (parts)", "MB"]
    columns += ["first sample, s", "MB", "device", "device, at most"]
    return table(columns, rows)


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


def profiles() -> str:
    """Time, size and noise of simulated medulla profiles."""
    rows = [
        [
            name,
            f"{row['wall_s']:.2f}",
            f"{row['warm_wall_s']:.3f}",
            f"{row['photons']:,}",
            f"{row['largest_relative_error']:.1%}",
            f"{row['kilobytes']:.0f}",
        ]
        for name, row in load("medulla_tables.json")["presets"].items()
    ]
    columns = ["preset", "caches empty, s", "caches full, s", "walks", "largest error of a bin"]
    return table([*columns, "kB on the device"], rows)


TABLES = {
    "start-circumstances": lambda: circumstances(*runs("start")),
    "start": start,
    "start-large-circumstances": lambda: circumstances(load(LARGE)),
    "start-large": start_large,
    "features-circumstances": lambda: circumstances(*runs("features")),
    "features": features,
    "stages-circumstances": lambda: circumstances(*runs("stages")),
    "end-to-end": end_to_end,
    "stages": stages,
    "peers-circumstances": lambda: circumstances(*runs("peers")),
    "peers": peers,
    "peer-causes-circumstances": lambda: circumstances(load(CAUSES)),
    "peer-causes": peer_causes,
    "profiles-circumstances": lambda: circumstances(load("medulla_tables.json")),
    "profiles": profiles,
}
