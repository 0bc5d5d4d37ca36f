"""How far a render is: a bar on a terminal or in a notebook, else a log line from time to time."""

from __future__ import annotations

import functools
import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, ParamSpec, Protocol, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

LOG_INTERVAL_S = 10.0
#: Between two updates of a bar in a notebook [s].
NOTEBOOK_INTERVAL_S = 0.2

log = logging.getLogger("furcl")


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
    """A progress bar in a notebook or on a terminal, else a log line every ten seconds."""
    if in_notebook():
        with _notebook_bar() as report:
            yield report
    elif sys.stderr.isatty():
        with _bar() as report:
            yield report
    else:
        yield _LogLines()


def showing_progress(function: Callable[P, T]) -> Callable[P, T]:
    """Let a function whose keyword `progress` takes a `Report` take True, for a bar, too."""

    @functools.wraps(function)
    def with_bar(*arguments: P.args, **keywords: P.kwargs) -> T:
        wanted = keywords.get("progress")
        if not isinstance(wanted, bool):
            return function(*arguments, **keywords)
        with progress_report() if wanted else nullcontext() as report:
            keywords["progress"] = report
            return function(*arguments, **keywords)

    return with_bar


def in_notebook() -> bool:
    """Whether the code is a cell of a notebook, which has a kernel."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return getattr(shell, "kernel", None) is not None


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


def _progress(**options: Any) -> Any:
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[speed]}"),
        **options,
    )


@contextmanager
def _bar() -> Iterator[Report]:
    from rich.console import Console

    console = Console(stderr=True, highlight=False, markup=False)
    with _progress(console=console) as progress:
        task = progress.add_task("setting up", total=None, speed="")
        speed = _Speed()

        def report(done: int, total: int) -> None:
            text = speed(done, total)
            progress.update(task, description="rendering", completed=done, total=total, speed=text)

        yield report


@contextmanager
def _notebook_bar() -> Iterator[Report]:
    """The same bar as the output of a cell, which is replaced: no widgets are needed."""
    from IPython.display import display

    progress = _progress()
    task = progress.add_task("setting up", total=None, speed="")
    output = display(progress.make_tasks_table(progress.tasks), display_id=True)
    speed, last = _Speed(), time.monotonic()

    def report(done: int, total: int) -> None:
        nonlocal last
        text = speed(done, total)
        progress.update(task, description="rendering", completed=done, total=total, speed=text)
        if output and (time.monotonic() - last >= NOTEBOOK_INTERVAL_S or done >= total):
            last = time.monotonic()
            output.update(progress.make_tasks_table(progress.tasks))

    try:
        yield report
    finally:
        if output:
            output.update(progress.make_tasks_table(progress.tasks))
