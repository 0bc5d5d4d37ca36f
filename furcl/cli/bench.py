"""`furcl bench ...`: measurements that write results.json and more to a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from furcl.cli.render import scene_path

app = typer.Typer(no_args_is_help=True, help="Measure; results go to a folder.")

Out = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")]
DeviceName = Annotated[
    str | None, typer.Option("--device", help="Number in `furcl devices`, P:D, or part of a name.")
]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", help="Replace a value of the scene: PATH=VALUE.")
]


def print_table(columns: list[str], rows: list[list[Any]]) -> None:
    """Print rows under headings; floats with four digits."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns)
    for row in rows:
        table.add_row(*[f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row])
    Console().print(table)


@app.command()
def stages(
    scene: Annotated[str, typer.Argument(help="A TOML scene, or one that comes with furcl.")],
    out: Out,
    device: DeviceName = None,
    spp: Annotated[int, typer.Option(help="Samples per pixel that are timed.")] = 8,
    overrides: Overrides = None,
) -> None:
    """Time every kernel of a render."""
    from furcl.bench import stages as bench

    results = bench.run(
        scene_path(scene), out, device=device, spp=spp, overrides=overrides or ()
    )
    rows = [
        [r["stage"], r["launches"], r["ms"], f"{r['share']:.1%}", r["million_per_second"], r["counts"]]
        for r in results["stages"]
    ]
    print_table(["kernel", "launches", "ms", "share", "million/s", "of"], rows)
    print(f"{results['mrays_s']:.3f} M rays/s; kernels are busy {results['busy']:.1%} of the time")


def register(parent: typer.Typer) -> None:
    """Add the commands to the app."""
    parent.add_typer(app, name="bench")
