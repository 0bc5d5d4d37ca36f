"""`furcl bench sampler`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from furcl.cli.options import SEED, DeviceName

EXIT_BIASED = 1


def sampler(
    name: Annotated[str, typer.Argument(help="A file of OpenCL C, FILE.clh, or a sampler's name.")],
    samples: Annotated[
        int, typer.Option(help="Of each fibre and inclination; a smaller bias needs more.")
    ] = 1 << 17,
    seed: Annotated[int, SEED] = 1,
    device: DeviceName = None,
) -> None:
    """Say whether a sampler is unbiased: weights, densities, counts and light samples.

    Ends with 1 if it is not.
    """
    from furcl import samplers

    if name.endswith(".clh"):
        name = samplers.register(Path(name).stem, name).name
    found = samplers.check(name, samples=samples, seed=seed, device=device)
    colour = typer.colors.GREEN if found.unbiased else typer.colors.RED
    typer.secho(str(found), fg=colour)
    if not found.unbiased:
        raise typer.Exit(EXIT_BIASED)
