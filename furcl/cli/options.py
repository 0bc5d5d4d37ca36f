"""Options that several benchmarks share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")]
DeviceName = Annotated[
    str | None, typer.Option("--device", help="Number in `furcl devices`, P:D, or part of a name.")
]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", help="Replace a value of the scene: PATH=VALUE.")
]
