"""Commands on files: `furcl info`, `furcl convert`, `furcl compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from furcl.cli.options import (
    Basis,
    DefaultRadius,
    DeviceName,
    Overrides,
    PointsPerStrand,
    RadiusScale,
    Scale,
    UpAxis,
)

if TYPE_CHECKING:
    from furcl.groom.curves import Curves


def info(
    file: Annotated[
        str, typer.Argument(help="A scene (.toml), the name of one of furcl's, or a groom.")
    ],
    device: DeviceName = None,
    overrides: Overrides = None,
    default_radius: DefaultRadius = None,
    radius_scale: RadiusScale = 1.0,
    scale: Scale = 1.0,
    up: UpAxis = None,
    basis: Basis = "linear",
    points_per_strand: PointsPerStrand = None,
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
        options = (default_radius, radius_scale, scale, up, basis, points_per_strand)
        _print_facts(facts.of_groom(path, _read_groom(path, *options)))
        return
    if (default_radius, radius_scale, scale, up) != (None, 1.0, 1.0, None):
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


def _read_groom(path, default_radius, radius_scale, scale, up, basis, points_per_strand) -> Curves:
    """A groom as the options say, turned to z where its file or they say what is up."""
    from furcl.groom.formats import load_curves
    from furcl.groom.orient import scaled, z_up

    curves = load_curves(
        path, default_radius, radius_scale, basis=basis, points_per_strand=points_per_strand
    )
    return z_up(scaled(curves, scale), up)


def convert(
    source: Annotated[Path, typer.Argument(help="A groom to read.")],
    target: Annotated[Path, typer.Argument(help="A groom to write; the suffix says the format.")],
    default_radius: DefaultRadius = None,
    radius_scale: RadiusScale = 1.0,
    scale: Scale = 1.0,
    up: UpAxis = None,
    basis: Basis = "linear",
    points_per_strand: PointsPerStrand = None,
) -> None:
    """Convert a groom to another format; docs/formats.md has what each holds.

    Lengths stay what they are but for --scale. A groom whose file says that y is up, or of which
    --up says it, is turned to z, exactly.
    """
    from furcl.groom.formats import save_curves

    options = (default_radius, radius_scale, scale, up, basis, points_per_strand)
    curves = _read_groom(source, *options)
    save_curves(curves, target)
    typer.echo(
        f"{target}: {curves.n_strands} strands, {curves.n_points} points; unit: {curves.units}"
    )


def compare(
    image: Annotated[Path, typer.Argument(help="An EXR image.")],
    reference: Annotated[Path, typer.Argument(help="The EXR image that counts as true.")],
) -> None:
    """RMSE, relMSE, FLIP and largest difference of two images."""
    from furcl.image.compare import compare as distances
    from furcl.image.denoise import refuse_denoised
    from furcl.image.image import Image

    pictures = [Image.load(path) for path in (image, reference)]
    refuse_denoised(pictures[1], str(reference), "give a render as the reference")
    found = distances(*pictures)
    at_most = found.get("z", {}).pop("at_most", False)
    for name, value in found.items():
        parts = value if isinstance(value, dict) else {"": value}
        text = ", ".join(f"{key} {_number(part)}".strip() for key, part in parts.items())
        typer.echo(f"{name:<10} {text}")
    if "denoised" in pictures[0].stats:
        typer.echo(f"{image}: is denoised: its error says nothing of samples")
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
