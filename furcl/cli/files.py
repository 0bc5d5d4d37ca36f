"""Commands on files: `furcl info`, `furcl convert`, `furcl compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def info(
    file: Annotated[Path, typer.Argument(help="A scene (.toml) or a groom.")],
    overrides: Annotated[
        list[str] | None, typer.Option("--set", help="Replace a value of a scene: PATH=VALUE.")
    ] = None,
) -> None:
    """Facts about a scene or a groom: counts, bounds, memory, features."""
    from furcl.info import describe

    for name, value in describe(file, overrides or ()).items():
        typer.echo(f"{name:<20} {value}")


def convert(
    source: Annotated[Path, typer.Argument(help="A groom to read.")],
    target: Annotated[Path, typer.Argument(help="A groom to write; the suffix says the format.")],
) -> None:
    """Convert a groom to another format."""
    from furcl.groom_io import load_curves, save_curves

    curves = load_curves(source)
    save_curves(curves, target)
    typer.echo(f"{target}: {curves.n_strands} strands, {curves.n_points} points")


def compare(
    image: Annotated[Path, typer.Argument(help="An EXR image.")],
    reference: Annotated[Path, typer.Argument(help="The EXR image that counts as true.")],
) -> None:
    """RMSE, relMSE, FLIP and largest difference of two images."""
    from furcl.compare import compare as distances
    from furcl.image import Image

    for name, value in distances(Image.load(image), Image.load(reference)).items():
        parts = value if isinstance(value, dict) else {"": value}
        text = ", ".join(f"{key} {_number(part)}".strip() for key, part in parts.items())
        typer.echo(f"{name:<10} {text}")


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command()(info)
    app.command()(convert)
    app.command()(compare)
