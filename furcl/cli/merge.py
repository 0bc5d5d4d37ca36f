"""`furcl merge`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

log = logging.getLogger(__name__)


def merge(
    pictures: Annotated[
        list[Path], typer.Argument(help="EXR files of one scene, with other samples each.")
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="OUT.exr; a PNG preview is written beside it."),
    ],
    stats: Annotated[Path | None, typer.Option(help="Write statistics to this JSON file.")] = None,
) -> None:
    """Merge renders of one scene, with other seeds or --samples each, to one picture."""
    from furcl.cli.outputs import Outputs
    from furcl.image.image import Image
    from furcl.image.merge import merged

    outputs = Outputs.of(output, stats)
    outputs.check(pictures)
    image = merged((Image.load(path) for path in pictures), [str(path) for path in pictures])
    outputs.write(image)
    log.info("%d pictures, %d samples a pixel", len(pictures), image.stats["spp"])


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command()(merge)
