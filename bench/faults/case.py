"""What a case of a fault is: something that went wrong once, run at full size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Case:
    """A fault that must be over.

    Attributes
    ----------
    name : str
    run : callable      run(folder, quick) returns one line of what happened; raises AssertionError
                        where it is wrong. `folder` is empty and its own; `quick` asks for a short
                        form.
    """

    name: str
    run: Callable[[Path, bool], str]
