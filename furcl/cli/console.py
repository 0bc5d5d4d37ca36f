"""What commands say while they run: log lines and progress, both on standard error."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console

CONSOLE = Console(stderr=True, highlight=False, markup=False)
LOG_INTERVAL_S = 10.0

log = logging.getLogger("furcl")


class _Handler(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        CONSOLE.print(f"furcl: {self.format(record)}", soft_wrap=True)


def set_up_logging(*, verbose: bool, quiet: bool) -> None:
    """Send furcl's log to standard error, above a progress bar that may be there."""
    log.handlers[:] = [_Handler()]
    log.propagate = False
    log.setLevel(logging.DEBUG if verbose else logging.WARNING if quiet else logging.INFO)


class Report(Protocol):
    """Takes the number of path samples done and of all."""

    def __call__(self, done: int, total: int) -> None:
        """Show it."""
        ...


def _rate(per_second: float) -> str:
    return f"{per_second / 1e6:.2f} M samples/s"


@contextmanager
def progress_report() -> Iterator[Report]:
    """A progress bar on a terminal, else a log line every ten seconds."""
    if CONSOLE.is_terminal:
        with _bar() as report:
            yield report
    else:
        yield _LogLines()


class _LogLines:
    def __init__(self) -> None:
        self.start = self.last = time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self.last < LOG_INTERVAL_S and done < total:
            return
        self.last = now
        seconds = max(now - self.start, 1e-3)
        left = seconds * (total - done) / max(done, 1)
        share = 100.0 * done / max(total, 1)
        log.info("%3.0f %%, %.0f s left, %s", share, left, _rate(done / seconds))


@contextmanager
def _bar() -> Iterator[Report]:
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("rendering"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[rate]}"),
    )
    with Progress(*columns, console=CONSOLE) as progress:
        task = progress.add_task("", total=None, rate="")
        start = time.monotonic()

        def report(done: int, total: int) -> None:
            seconds = max(time.monotonic() - start, 1e-3)
            progress.update(task, completed=done, total=total, rate=_rate(done / seconds))

        yield report
