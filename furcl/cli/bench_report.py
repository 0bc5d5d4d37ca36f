"""`furcl bench report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from furcl.cli.options import METRIC


def report(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders of results; those inside are found.")
    ],
    metric: Annotated[str, METRIC] = "rmse",
    scene: Annotated[
        list[str] | None,
        typer.Option(help="Only this one in figures and table for papers; may be repeated."),
    ] = None,
) -> None:
    """Make the pages and plots of convergence and stability anew from their results.json.

    Crops need the run's images/ too; without them a page has none.
    """
    from furcl.report.pages import write_pages

    for page in write_pages(*folders, metrics=metric.split(","), scenes=scene or ()):
        typer.echo(page)
