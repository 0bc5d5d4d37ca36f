"""The command `furcl`. Commands import what they need when they run: `furcl --help` is fast."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

import typer

from furcl.cli import bench, devices, files, render
from furcl.cli.console import set_up_logging
from furcl.errors import FurclError, NoDeviceError

EXIT_ERROR = 2
EXIT_NO_DEVICE = 3

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Render hair and fur with OpenCL.",
    epilog="Exit codes: 0 done, 2 bad input, 3 no usable OpenCL device, 130 interrupted. "
    "FURCL_DEVICE chooses the device, FURCL_DEBUG=1 shows tracebacks.",
)


@app.callback()
def _options(
    verbose: bool = typer.Option(False, "--verbose", "-v", help="Say what takes how long."),
    quiet: bool = typer.Option(False, "--quiet", "-q", help="Warnings only."),
) -> None:
    set_up_logging(verbose=verbose, quiet=quiet)


render.register(app)
files.register(app)
devices.register(app)
bench.register(app)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; always ends with SystemExit."""
    try:
        app(arguments)
    except ModuleNotFoundError as error:
        if os.environ.get("FURCL_DEBUG") or (error.name or "").startswith("furcl"):
            raise
        print(f"furcl: {error}; install it: pip install 'furcl[report]'", file=sys.stderr)
        sys.exit(EXIT_ERROR)
    except FurclError as error:
        if os.environ.get("FURCL_DEBUG"):
            raise
        print(f"furcl: {error}", file=sys.stderr)
        sys.exit(EXIT_NO_DEVICE if isinstance(error, NoDeviceError) else EXIT_ERROR)
