"""Which furcl made a picture: version, and commit when it runs from a checkout."""

from __future__ import annotations

import functools
import importlib.metadata
import subprocess
from pathlib import Path


@functools.cache
def software() -> dict[str, str]:
    """`version` of the installed package, and `git` (commit, -dirty if changed) in a checkout."""
    found = {}
    try:
        found["version"] = importlib.metadata.version("furcl")
    except importlib.metadata.PackageNotFoundError:
        found["version"] = "not installed"
    root = Path(__file__).parents[1]
    if (root / ".git").exists():
        command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
        except (OSError, subprocess.SubprocessError):
            return found
        found["git"] = done.stdout.strip()
    return found
