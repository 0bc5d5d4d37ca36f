"""Switches that are set in the environment.

FURCL_DEBUG=1       kernels check their indices
FURCL_TRACEBACK=1   the command shows where in the code an error arose
"""

from __future__ import annotations

import os


def switched_on(name: str) -> bool:
    """Whether a switch is set: to anything but "" and "0"."""
    return os.environ.get(name, "") not in ("", "0")
