"""`furcl bcsdf`: what a fibre sends from one direction to another, in float64."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Annotated, Any

import typer

from furcl.cli.options import DeviceName


def bcsdf(
    model: Annotated[str, typer.Argument(help="A fibre model, such as double-cylinder.")],
    wo: Annotated[
        str | None, typer.Option(help="The known direction, to the camera: X,Y,Z; x is the fibre.")
    ] = None,
    wi: Annotated[str | None, typer.Option(help="The other one, to the light: X,Y,Z.")] = None,
    h: Annotated[
        float | None,
        typer.Option("--h", help="Offset of the ray, -1 to 1; left out: the mean over it."),
    ] = None,
    values: Annotated[
        list[str] | None,
        typer.Option("--set", help="A key of the scene's table [fibre]: KEY=VALUE."),
    ] = None,
    sampling: Annotated[str, typer.Option(help="Sampler of the densities.")] = "full-cdf",
    residual: Annotated[
        bool, typer.Option("--residual", help="With the lobe of all later orders.")
    ] = False,
    unscattered: Annotated[
        bool,
        typer.Option(
            "--unscattered", help="Leave out what a medulla scatters, which needs a device."
        ),
    ] = False,
    tables: Annotated[
        Path | None, typer.Option(help="Write the tables that kernels read to a .npz file.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    device: DeviceName = None,
) -> None:
    """Value, densities and lobes of a fibre between two directions, in float64.

    Directions are in the fibre's frame and are made unit vectors; docs/oracle.md has the meaning of
    all numbers. They are printed so that reading them gives the same float64.
    """
    from furcl.errors import FibreError
    from furcl.fibre.model import find, model_of
    from furcl.oracle.bcsdf_values import bcsdf_values, save_tables

    find(model)
    if (wo is None) != (wi is None) or (wo is None and tables is None):
        raise FibreError(
            "furcl bcsdf: give --wo and --wi, or --tables FILE.npz: there is nothing to print"
        )
    if wo is None and h is not None:
        raise FibreError("furcl bcsdf: --h belongs to --wo and --wi; give them, or leave it out")
    fibre = _fibre(model, values or [])
    if tables:
        shapes = save_tables(tables, fibre, sampling=sampling, residual=residual, device=device)
        if wo is None or not as_json:
            for name, shape in shapes.items():
                typer.echo(f"{tables}: {name} {shape}")
    if wo is None or wi is None:
        return
    directions = {"wo": _direction("wo", wo), "wi": _direction("wi", wi)}
    found = bcsdf_values(
        fibre,
        directions["wo"],
        directions["wi"],
        h,
        _prepared(model_of(fibre), fibre, residual, unscattered, device),
        sampling=sampling,
        residual=residual,
    )
    if as_json:
        typer.echo(json.dumps(_document(model, fibre, directions, h, sampling, found), indent=2))
        return
    typer.echo(f"value {_numbers(found['value'])}  pdf {_numbers(found['pdf'])}")
    for name, lobe in found["lobes"].items():
        told = "  ".join(f"{key} {_numbers(value)}" for key, value in lobe.items())
        typer.echo(f"{name:<9} {told}")


def _fibre(model: str, values: list[str]) -> Any:
    """The fibre that a scene's table [fibre] of these values describes.

    Raises
    ------
    SceneError      a key that the model does not have, or a value outside its range
    """
    from furcl.scene.overrides import apply_overrides
    from furcl.scene.read import decode_scene

    document = {
        "fibre": {"model": model},
        "environment": {"kind": "constant"},
        "curves": {"generator": "fibre"},
    }
    changes = [f"fibre.{value}" for value in values]
    return decode_scene(apply_overrides(document, changes), "furcl bcsdf").build_fibre()


def _direction(name: str, text: str) -> Any:
    """A unit vector (3,) float64."""
    import numpy as np

    from furcl.errors import FibreError

    try:
        vector = np.array([float(part) for part in text.split(",")])
        length = float(np.linalg.norm(vector))
    except ValueError:
        vector, length = np.zeros(0), 0.0
    if vector.shape != (3,) or not 0.0 < length < np.inf:
        raise FibreError(
            f"furcl bcsdf: --{name} {text}: allowed are three numbers X,Y,Z, not all 0; x is along "
            f"the fibre, root to tip"
        )
    return vector / length


def _prepared(model: Any, fibre: Any, residual: bool, unscattered: bool, device: Any) -> Any:
    """What the model prepares for a fibre, on a device, or what stands for it."""
    from furcl.device.choice import open_device
    from furcl.fibre.double_cylinder.reference import UNSCATTERED

    if unscattered:
        return UNSCATTERED
    if model.features(fibre, residual=residual).data_words == 0:
        return None
    return model.prepare(open_device(device), fibre)


def _document(
    model: str, fibre: Any, directions: dict[str, Any], h: float | None, sampling: str, found: Any
) -> dict[str, Any]:
    """Everything, of plain values."""
    return {
        "model": model,
        "fibre": dataclasses.asdict(fibre),
        **{name: vector.tolist() for name, vector in directions.items()},
        "h": h,
        "sampling": sampling,
        **found,
    }


def _numbers(value: Any) -> str:
    """Numbers with 17 digits, which tell every float64 from its neighbours."""
    return ",".join(f"{x:.17g}" for x in (value if isinstance(value, list) else [value]))


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command()(bcsdf)
