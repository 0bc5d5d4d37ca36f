"""The command `furcl`. Commands import what they need when they run: `furcl --help` is fast."""

from __future__ import annotations

import gc
import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated, Any, NoReturn

import typer

from furcl.cli import bcsdf, bench, denoise, devices, files, merge, new, render, view
from furcl.cli.console import set_up_logging
from furcl.cli.losable import losable_log
from furcl.device import crashes
from furcl.errors import FurclError, NoDeviceError
from furcl.memory import little_address_space
from furcl.settings import switched_on

EXIT_ERROR = 2
EXIT_NO_DEVICE = 3
EXIT_INTERRUPTED = 130

# What the extra `report` installs.
REPORT_MODULES = ("flip_evaluator", "jinja2", "matplotlib", "numba", "pcpp")

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


def _verbose(given: bool) -> None:
    if given:
        set_up_logging(verbose=True)


def _quiet(given: bool) -> None:
    if given:
        set_up_logging(quiet=True)


@app.callback()
def _everywhere(
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            "-v",
            help="Say what takes how long.",
            callback=_verbose,
            expose_value=False,
        ),
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option("--quiet", "-q", help="Warnings only.", callback=_quiet, expose_value=False),
    ] = False,
) -> None:
    """Options that stand before or after the command; what they do is in their callbacks."""


for part in (render, view, new, merge, denoise, files, bcsdf, devices, bench):
    part.register(app)


def command() -> Any:
    """All commands, each of which takes the options of `furcl` itself too."""
    root = typer.main.get_command(app)
    _add_options(root, [option for option in root.params if option.name in ("verbose", "quiet")])
    return root


def _add_options(group: Any, options: list[Any]) -> None:
    for inner in group.commands.values():
        inner.params += options
        if hasattr(inner, "commands"):
            _add_options(inner, options)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; always ends with SystemExit."""
    _start_fast()
    with losable_log():
        _write_any_letter()
        set_up_logging()
        crashes.watch()
        try:
            _run(arguments)
        finally:
            _flush()
            crashes.forget()


def _run(arguments: Sequence[str] | None) -> None:
    try:
        command()(arguments)
    except ModuleNotFoundError as error:
        if switched_on("FURCL_TRACEBACK") or (error.name or "").startswith("furcl"):
            raise
        module = (error.name or "").partition(".")[0]
        wanted = "'furcl[report]'" if module in REPORT_MODULES else "--force-reinstall furcl"
        _refuse(f"{error}; install it: pip install {wanted}")
    except FurclError as error:
        if switched_on("FURCL_TRACEBACK"):
            raise
        code = EXIT_NO_DEVICE if isinstance(error, NoDeviceError) else EXIT_ERROR
        note = "" if little_address_space() in str(error) else _little_memory()
        _refuse(f"{error}{note}", code)
    except OSError as error:
        # Of the system: a full disk, rights, limits. Others are faults, and show where they arose.
        if switched_on("FURCL_TRACEBACK") or not (error.strerror or _little_memory()):
            raise
        where = f"{error.filename}: " if error.filename else ""
        _refuse(f"{where}{error.strerror or error}{_little_memory()}")
    except MemoryError:
        if switched_on("FURCL_TRACEBACK"):
            raise
        _refuse(f"the memory is used up{_little_memory()}; make the scene or picture smaller")
    except SystemExit as error:
        if type(error.__context__).__name__ == "Abort":  # Ctrl-C, which the parser ends with 1
            sys.exit(EXIT_INTERRUPTED)
        raise


def _refuse(message: str, code: int = EXIT_ERROR) -> NoReturn:
    print(f"furcl: {message}", file=sys.stderr)
    sys.exit(code)


def _little_memory() -> str:
    """What to add to an error that may come of too little address space."""
    said = little_address_space()
    return f" ({said})" if said else ""


def _write_any_letter() -> None:
    """Spell what the terminal's encoding lacks, rather than fail."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _flush() -> None:
    """Write out what was printed; where that fails, say so and end with an error."""
    try:
        if sys.stdout:
            sys.stdout.flush()
    except (OSError, ValueError) as error:
        with suppress(OSError, ValueError):  # or Python would try again at its end
            sys.stdout.close()
        _refuse(f"standard output cannot be written: {getattr(error, 'strerror', error)}")


def _start_fast() -> None:
    """Keep Python and numpy from what costs a command a tenth of its first second."""
    # The threads of numpy's BLAS wait in a loop, on cores that others need.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What is loaded stays: the collector would look through it again and again.
    gc.set_threshold(100_000)
