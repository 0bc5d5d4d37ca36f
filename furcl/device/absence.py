"""Why an OpenCL runtime that is installed offers no device, or none that works."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

POCL = "Portable Computing Language"


def pocl_cache_folder() -> Path:
    """Where PoCL keeps what it builds, by the environment."""
    named = os.environ.get("POCL_CACHE_DIR")
    if named:
        return Path(named)
    home = os.environ.get("HOME")
    base = os.environ.get("XDG_CACHE_HOME") or (f"{home}/.cache" if home else "/tmp")
    return Path(base) / "pocl" / "kcache"


def pocl_cache_problem() -> tuple[str, str] | None:
    """What keeps PoCL from its cache folder, and what mends it; None if nothing does.

    Without that folder PoCL offers no device, or builds nothing.
    """
    folder = pocl_cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".furcl-"):
            return None
    except OSError as error:
        return (
            f"PoCL cannot write its cache folder {folder} ({error.strerror})",
            "make it writable, or set POCL_CACHE_DIR to a folder that is",
        )
