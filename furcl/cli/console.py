"""What commands say while they run: log lines on standard error, and tables."""

from __future__ import annotations

import logging
import sys
from typing import Any

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
