"""Switches that are set in the environment.

FURCL_DEBUG=1       kernels check their indices
FURCL_TRACEBACK=1   the command shows where in the code an error arose
"""

from __future__ import annotations

import os
from pathlib import Path


def switched_on(name: str) -> bool:
    """Whether a switch is set: to anything but "" and "0"."""
    return os.environ.get(name, "") not in ("", "0")


def leave_out_unusable_caches() -> None:
    """Tell pyopencl, before it is imported, to do without its caches where the user's folder for
    caches cannot be written: it fails otherwise. furcl keeps kernels in a cache of its own."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    while not folder.exists() and folder.parent != folder:
        folder = folder.parent
    if not os.access(folder, os.W_OK | os.X_OK):
        os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
