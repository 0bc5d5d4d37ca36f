"""One way to break furcl, and what must happen instead."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


class NotHereError(Exception):
    """What a case needs is not on this machine."""


@dataclass(frozen=True)
class Case:
    """A fault that furcl must not have.

    Attributes
    ----------
    name : str          what is done
    run : callable      takes an empty folder and whether to be quick; returns one line of what
                        happened, raises AssertionError where that is wrong and NotHereError where
                        the case cannot be tried
    """

    name: str
    run: Callable[[Path, bool], str]
