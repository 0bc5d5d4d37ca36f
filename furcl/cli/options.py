"""The arguments and options that several commands share: each is declared here, once.

Those whose type or default differs between commands are options alone, to be put into `Annotated`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

SceneName = Annotated[
    str,
    typer.Argument(help="A TOML scene, the name of one that comes with furcl, or a groom."),
]
SceneNames = Annotated[
    list[str], typer.Argument(help="TOML scenes, or names of those that come with furcl.")
]


def results_folder(folder: Path) -> Path:
    """Refuse a folder in which results could not be written at the end of a benchmark; makes it.

    Raises
    ------
    BenchError
    """
    from furcl.errors import BenchError
    from furcl.files import check_writable

    check_writable(folder / "results.json", BenchError)
    return folder


Folder = Annotated[
    Path,
    typer.Option("--output", "-o", help="Folder for the results.", callback=results_folder),
]
DeviceName = Annotated[
    str | None, typer.Option("--device", help="Number in `furcl devices`, P:D, or part of a name.")
]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", help="Replace a value of the scene: PATH=VALUE.")
]
Dask = Annotated[
    str | None,
    typer.Option("--dask", help="Address of a Dask scheduler, whose workers share the work."),
]
WaveSize = Annotated[
    int | None,
    typer.Option(min=1, help="Paths traced together; changes the speed, not the picture."),
]
DefaultRadius = Annotated[
    float | None, typer.Option(help="Radius where a groom has none [unit of the file].")
]
RadiusScale = Annotated[float, typer.Option(help="Factor on all radii of a groom.")]
Scale = Annotated[float, typer.Option(help="Factor on all lengths of a groom.")]
UpAxis = Annotated[
    str | None,
    typer.Option(
        "--up", help="x, y or z: axis that is up, turned to z; what the file says if left out."
    ),
]
Basis = Annotated[
    str,
    typer.Option(
        help="What points are where a groom does not say: linear (corners), or control points: "
        "bezier, bspline, catmull-rom."
    ),
]
Material = Annotated[
    str | None, typer.Option(help="Fibre of a groom without a scene: a preset, or a model.")
]
PointsPerStrand = Annotated[
    int | None, typer.Option(help="Where a groom does not say where strands begin.")
]

SIZE = typer.Option("--size", help="Film size, WIDTHxHEIGHT.")
SPP = typer.Option("--spp", min=1, help="Samples per pixel; of a benchmark, in each round.")
SEED = typer.Option("--seed", help="All random numbers follow from it.")
ROUNDS = typer.Option("--rounds", min=1, help="Times that each is measured.")
METRIC = typer.Option(
    help="What figures show: rmse, relmse or flip, or several, A,B; the page the first."
)
QUICK = typer.Option("--quick", help="Small and few, to try the command.")
VARIANT = typer.Option(help="One to compare: 'NAME: KEY=VALUE ...', keys of [render] and [film].")
SAMPLING = typer.Option(help="The short form: names of samplers, A,B,C, each a variant.")
SAMPLER_FILE = typer.Option(
    "--sampler", help="A sampler of your own, FILE.clh: registered under its name and used."
)
