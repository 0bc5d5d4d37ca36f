"""The command `furcl`. Commands import what they need when they run: `furcl --help` is fast."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence

import typer

from furcl.cli import bench, devices, files, render
from furcl.cli.console import set_up_logging
from furcl.errors import FurclError, NoDeviceError
from furcl.settings import switched_on

EXIT_ERROR = 2
EXIT_NO_DEVICE = 3

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Render hair and fur with OpenCL.",
    epilog="Exit codes: 0 done, 2 bad input, 3 no usable OpenCL device, 130 interrupted. "
    "FURCL_DEVICE chooses the device, FURCL_DEBUG=1 makes kernels check their indices, "
    "FURCL_TRACEBACK=1 shows tracebacks.",
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
    _start_fast()
    try:
        app(arguments)
    except ModuleNotFoundError as error:
        if switched_on("FURCL_TRACEBACK") or (error.name or "").startswith("furcl"):
            raise
        print(f"furcl: {error}; install it: pip install 'furcl[report]'", file=sys.stderr)
        sys.exit(EXIT_ERROR)
    except FurclError as error:
        if switched_on("FURCL_TRACEBACK"):
            raise
        print(f"furcl: {error}", file=sys.stderr)
        sys.exit(EXIT_NO_DEVICE if isinstance(error, NoDeviceError) else EXIT_ERROR)


def _start_fast() -> None:
    """Keep Python and numpy from what costs a command a tenth of its first second."""
    # The threads of numpy's BLAS wait in a loop, on cores that others need.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What is loaded stays: the collector would look through it again and again.
    gc.set_threshold(100_000)
