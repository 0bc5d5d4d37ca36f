"""`furcl denoise`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def denoise(
    picture: Annotated[Path, typer.Argument(help="An EXR picture.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="OUT.exr; a PNG preview is written beside it."),
    ],
) -> None:
    """Take the noise out of a picture by Open Image Denoise: biased, for previews.

    Rendered with --denoise, or with the layers albedo, normal and tangent, it keeps more detail.
    """
    from furcl.cli.outputs import Outputs
    from furcl.image.denoise import denoised
    from furcl.image.image import Image

    outputs = Outputs.of(output, None)
    outputs.check([picture])
    outputs.write(denoised(Image.load(picture)))


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command()(denoise)
