"""`furcl bench ...`: measurements that write results.json and more to a folder."""

from __future__ import annotations

from typing import Annotated

import typer

from furcl.cli.bench_convergence import convergence
from furcl.cli.bench_report import report
from furcl.cli.bench_sampler import sampler
from furcl.cli.bench_stability import replay, stability
from furcl.cli.bench_stages import stages, waves
from furcl.cli.bench_start import start
from furcl.cli.bench_variance import variance
from furcl.cli.console import print_table
from furcl.cli.options import ROUNDS, SIZE, SPP, DeviceName, Folder, Overrides, SceneNames

app = typer.Typer(no_args_is_help=True, help="Measure; results go to a folder.")


@app.command()
def intersect(
    groom: Annotated[
        str, typer.Argument(help="A groom file, a scene, or hair:N, fur:N, head:N for N segments.")
    ],
    out: Folder,
    device: DeviceName = None,
    size: Annotated[int, typer.Option(help="Width and height of the primary rays [px].")] = 512,
    rounds: Annotated[int, ROUNDS] = 5,
) -> None:
    """Trace rays beside Embree: speed, ratio and differences."""
    from furcl.bench import intersect as bench

    results = bench.run(groom, out, device=device, size=size, rounds=rounds)
    cpu = results["build_cpu_seconds"]
    print(
        f"{results['segments']} segments, {results['bytes_per_segment']:.1f} bytes each; built in "
        f"{results['build_seconds']:.2f} s"
        + (f", {cpu:.2f} processor seconds" if cpu is not None else "")
        + f" (Embree {results['embree_build_seconds']:.2f} s)"
    )
    memory = {name: n / 1e6 for name, n in results["build_bytes"].items()}
    print(
        f"memory [MB]: groom {results['groom_bytes'] / 1e6:.0f}; device {memory['device']:.0f}, "
        f"while building {memory['device_peak']:.0f}; host before the groom "
        f"{memory['host_start']:.0f}, largest until built {memory['host_peak']:.0f}"
    )
    keys = ["kind", "n", "hit", "mrays_s", "embree_mrays_s", "ratio", "cpu_ratio", "disagreements"]
    columns = ["rays", "number", "hit", "M/s", "Embree M/s", "ratio", "CPU ratio", "disagree"]
    rows = [[row[key] for key in keys] for row in results["rays"]]
    print_table(columns, [[*row[:-1], f"{row[-1]:.0e}"] for row in rows])


app.command()(stages)
app.command()(waves)
app.command()(convergence)
app.command()(variance)
app.command()(sampler)
app.command()(stability)
app.command()(replay)
app.command()(start)
app.command()(report)


@app.command()
def features(
    scenes: SceneNames,
    out: Folder,
    device: DeviceName = None,
    size: Annotated[str, SIZE] = "128x128",
    spp: Annotated[int, SPP] = 4,
    rounds: Annotated[int, ROUNDS] = 5,
    overrides: Overrides = None,
) -> None:
    """Compare each scene's specialised build with one that has everything on."""
    from furcl.bench import features as bench

    results = bench.run(
        scenes,
        out,
        device=device,
        size=size,
        spp=spp,
        rounds=rounds,
        overrides=overrides or (),
    )
    rows = []
    for row in results["scenes"]:
        lean, full = (row["builds"][build] for build in bench.BUILDS)
        rows.append(
            [
                row["scene"],
                row["time_ratio"],
                row["bytes_ratio"],
                f"{lean['compile_seconds']:.1f} / {full['compile_seconds']:.1f}",
                f"{lean['source_bytes']} / {full['source_bytes']}",
                "equal bits" if row["pictures"]["equal"] else f"z = {row['pictures']['z']:.2f}",
            ]
        )
    columns = ["scene", "times faster", "bytes ratio", "compile s", "source bytes", "pictures"]
    print_table(columns, rows)


def register(parent: typer.Typer) -> None:
    """Add the commands to the app."""
    parent.add_typer(app, name="bench")
