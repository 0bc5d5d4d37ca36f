"""`furcl new`: a scene file to begin with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from furcl.cli.options import Material, UpAxis


def new(
    scene: Annotated[Path, typer.Argument(help="The scene to write, .toml; none is replaced.")],
    groom: Annotated[Path, typer.Option(help="Its groom: docs/formats.md.")],
    mesh: Annotated[Path | None, typer.Option(help="A mesh beside it, .obj or .ply.")] = None,
    material: Material = None,
    up: UpAxis = None,
) -> None:
    """Write a commented scene of a groom, that renders as it is."""
    from furcl.scene.from_groom import MATERIAL, write_scene

    write_scene(scene, groom, mesh, material or MATERIAL, up)
    typer.echo(f"{scene}: furcl render {scene} -o {scene.stem}.exr")


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command()(new)
