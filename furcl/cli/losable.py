"""A log whose loss loses nothing else: standard error may be closed, full, or a pipe without a
reader, and what the command makes is made."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO, cast


class _Losable:
    """A stream that loses what cannot be written, and spells letters that its encoding lacks."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write, or lose it."""
        with suppress(OSError, ValueError):
            self._stream.write(text)
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write, or lose them."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Flush what can be flushed."""
        with suppress(OSError, ValueError):
            self._stream.flush()

    def isatty(self) -> bool:
        """Whether it is a terminal that is there."""
        with suppress(OSError, ValueError):
            return self._stream.isatty()
        return False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def losable_log() -> Iterator[None]:
    """Make standard error a stream that loses what it cannot write."""
    _open_closed_descriptors()
    before = sys.stderr
    with ExitStack() as stack:
        stream = before or stack.enter_context(Path(os.devnull).open("w", encoding="utf-8"))
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
        sys.stderr = cast(TextIO, _Losable(stream))
        try:
            yield
        finally:
            sys.stderr = before
            _give_up(before)


def _open_closed_descriptors() -> None:
    """Let no file that is opened later be taken for standard output or error."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free


def _give_up(stream: TextIO | None) -> None:
    """Let what a stream could not write go: Python, which tries again at its end, would end with
    an error."""
    if not stream:
        return
    try:
        stream.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
            stream.flush()
