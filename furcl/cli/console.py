"""What commands say while they run: log lines and progress, both on standard error."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

LOG_INTERVAL_S = 10.0

log = logging.getLogger("furcl")


class _Handler(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        print(f"furcl: {self.format(record)}", file=sys.stderr)  # which a progress bar catches


def set_up_logging(*, verbose: bool = False, quiet: bool = False) -> None:
    """Send furcl's log to standard error, above a progress bar that may be there."""
    log.handlers[:] = [_Handler()]
    log.propagate = False
    log.setLevel(logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO)


def print_table(columns: list[str], rows: list[list[Any]]) -> None:
    """Print rows under headings; floats with four digits. Nothing is cut off in a file or pipe."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns)
    for row in rows:
        table.add_row(*[f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row])
    console = Console()
    if not console.is_terminal:
        console.width = 1000  # a table takes what it needs
    console.print(table)


class Report(Protocol):
    """Takes the number of path samples done and of all."""

    def __call__(self, done: int, total: int) -> None:
        """Show it."""
        ...


class _Speed:
    """Path samples a second and seconds left, from the first report on: without the set-up."""

    def __init__(self) -> None:
        self.first: tuple[float, int] | None = None

    def __call__(self, done: int, total: int) -> str:
        now = time.monotonic()
        if self.first is None:
            self.first = (now, done)
        seconds, samples = now - self.first[0], done - self.first[1]
        if seconds <= 0.0 or samples <= 0:
            return ""
        rate = samples / seconds
        return f"{rate / 1e6:.2f} M samples/s, {(total - done) / rate:.0f} s left"


@contextmanager
def progress_report() -> Iterator[Report]:
    """A progress bar on a terminal, else a log line every ten seconds."""
    if sys.stderr.isatty():
        with _bar() as report:
            yield report
    else:
        yield _LogLines()


class _LogLines:
    def __init__(self) -> None:
        self.last = time.monotonic()
        self.speed = _Speed()

    def __call__(self, done: int, total: int) -> None:
        speed = self.speed(done, total)
        if time.monotonic() - self.last < LOG_INTERVAL_S and done < total:
            return
        self.last = time.monotonic()
        log.info("%s", f"{100.0 * done / total:3.0f} %, {speed}".rstrip(", "))


@contextmanager
def _bar() -> Iterator[Report]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[speed]}"),
    )
    console = Console(stderr=True, highlight=False, markup=False)
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("setting up", total=None, speed="")
        speed = _Speed()

        def report(done: int, total: int) -> None:
            text = speed(done, total)
            progress.update(task, description="rendering", completed=done, total=total, speed=text)

        yield report
