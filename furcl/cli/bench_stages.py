"""`furcl bench stages` and `furcl bench waves`: where the time of renders goes."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from furcl.cli.console import print_table
from furcl.cli.options import ROUNDS, SPP, DeviceName, Folder, Overrides, SceneNames, WaveSize


def stages(
    scenes: SceneNames,
    out: Folder,
    device: DeviceName = None,
    spp: Annotated[int, SPP] = 8,
    rounds: Annotated[int, ROUNDS] = 1,
    wave_size: WaveSize = None,
    overrides: Overrides = None,
) -> None:
    """Time every kernel of renders, and the renders beside their rays alone.

    Of several rounds the one of median time is shown.
    """
    from furcl.bench import stages as bench

    results = bench.run(
        scenes,
        out,
        device=device,
        spp=spp,
        rounds=rounds,
        wave_size=wave_size,
        overrides=overrides or (),
    )
    keys = ["stage", "launches", "ms", "share", "million_per_second", "counts"]
    columns = ["kernel", "launches", "ms", "share", "million/s", "of"]
    for scene in results["scenes"]:
        print(f"{scene['scene']}: waves of {scene['wave_size']} ({scene['wave_size_from']})")
        print_table(columns, [[row[key] for key in keys] for row in scene["stages"]])
    keys = ["scene", "mpaths_s", "mrays_s", "intersect_mrays_s"]
    keys += ["end_to_end", "launch_overhead", "cores_busy"]
    columns = ["scene", "M paths/s", "M rays/s", "intersect alone"]
    columns += ["end to end", "launches", "cores busy"]
    print_table(columns, [[scene[key] for key in keys] for scene in results["scenes"]])


def waves(
    scenes: SceneNames,
    out: Folder,
    sizes: Annotated[str, typer.Option(help="Paths; compared with the first.")] = (
        "32768,16384,65472,131072"
    ),
    device: DeviceName = None,
    spp: Annotated[int, SPP] = 4,
    rounds: Annotated[int, ROUNDS] = 11,
    overrides: Overrides = None,
) -> None:
    """Compare wave sizes, which take turns."""
    from furcl.bench import waves as bench

    try:
        numbers = [int(size) for size in sizes.split(",")]
    except ValueError:
        raise typer.BadParameter(f"{sizes!r}: give numbers such as 32768,65472") from None
    results = bench.run(
        scenes,
        out,
        sizes=numbers,
        device=device,
        spp=spp,
        rounds=rounds,
        overrides=overrides or (),
    )
    rows = [
        [
            scene["scene"],
            row["size"],
            row["mpaths_s"],
            _median(row["ratio"]),
            _median(row["cpu_ratio"]),
        ]
        for scene in results["scenes"]
        for row in scene["rows"]
    ]
    print_table(["scene", "paths", "M paths/s", "times faster", "by processor seconds"], rows)


def _median(found: dict[str, Any] | None) -> str:
    """A median as "median [low, high]"."""
    if found is None:
        return "-"
    ends = "" if found["low"] is None else f" [{found['low']:.3f}, {found['high']:.3f}]"
    return f"{found['median']:.3f}{ends}"
