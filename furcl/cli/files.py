"""Commands on files: `furcl info`, `furcl convert`, `furcl compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from furcl.cli.options import DefaultRadius, DeviceName, Overrides, RadiusScale


def info(
    file: Annotated[
        str, typer.Argument(help="A scene (.toml), the name of one of furcl's, or a groom.")
    ],
    device: DeviceName = None,
    overrides: Overrides = None,
    default_radius: DefaultRadius = None,
    radius_scale: RadiusScale = 1.0,
) -> None:
    """Facts about a scene or a groom: counts, bounds, lobe shares, features, memory.

    What a scene needs of a device is found by setting up its render. Nothing is rendered.
    """
    from furcl.cli import facts
    from furcl.errors import NoDeviceError
    from furcl.scene.read import find_scene, load_scene

    path = find_scene(file)
    if path.suffix.lower() != ".toml":
        if overrides:
            raise typer.BadParameter(f"--set changes scenes, and {path} is read as a groom")
        _print_facts(facts.of_groom(path, default_radius, radius_scale))
        return
    if default_radius is not None or radius_scale != 1.0:
        raise typer.BadParameter(
            "of a scene give --set curves.default_radius=R and --set curves.radius_scale=S"
        )
    scene = load_scene(path, overrides=overrides or ())
    _print_facts(facts.of_scene(scene))
    try:
        _print_facts(facts.on_device(scene, device))
    except NoDeviceError as error:
        reason = f"none, so what the scene needs of it is not known: {error}"
        _print_facts({"device": reason})


def _print_facts(facts: dict[str, str]) -> None:
    for name, value in facts.items():
        typer.echo(f"{name:<20} {value}")


def convert(
    source: Annotated[Path, typer.Argument(help="A groom to read.")],
    target: Annotated[Path, typer.Argument(help="A groom to write; the suffix says the format.")],
    default_radius: DefaultRadius = None,
    radius_scale: RadiusScale = 1.0,
) -> None:
    """Convert a groom to another format."""
    from furcl.groom.formats import load_curves, save_curves

    curves = load_curves(source, default_radius, radius_scale)
    save_curves(curves, target)
    typer.echo(f"{target}: {curves.n_strands} strands, {curves.n_points} points")


def compare(
    image: Annotated[Path, typer.Argument(help="An EXR image.")],
    reference: Annotated[Path, typer.Argument(help="The EXR image that counts as true.")],
) -> None:
    """RMSE, relMSE, FLIP and largest difference of two images."""
    from furcl.image.compare import compare as distances
    from furcl.image.image import Image

    found = distances(Image.load(image), Image.load(reference))
    at_most = found.get("z", {}).pop("at_most", False)
    for name, value in found.items():
        parts = value if isinstance(value, dict) else {"": value}
        text = ", ".join(f"{key} {_number(part)}".strip() for key, part in parts.items())
        typer.echo(f"{name:<10} {text}")
    if at_most:
        typer.echo(
            'z: of sequence "sobol" a picture knows an upper bound of its variance, so mean, rms '
            "and share_above_3 are too small; whole is not. Compare several seeds, or pictures "
            "with render.sequence=independent"
        )


def _number(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def register(app: typer.Typer) -> None:
    """Add the commands to the app."""
    app.command()(info)
    app.command()(convert)
    app.command()(compare)
