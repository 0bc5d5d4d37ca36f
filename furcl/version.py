"""Which furcl made a picture or a result: version, and commit when it runs from a checkout."""

from __future__ import annotations

import functools
import importlib.metadata
import os
import subprocess
from pathlib import Path

# What decides what is computed and how it is measured. Results and documents may change without
# making a result that is being written one of an unknown state.
CODE = (
    "kernels", "furcl", "scenes", "bench", ":(exclude)bench/results", "pyproject.toml",
    "requirements.lock",
)  # fmt: skip

# Git sets these for its hooks; they would lead it to another repository than the one asked about.
_GIT_VARIABLES = ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE", "GIT_PREFIX")


@functools.cache
def software() -> dict[str, str]:
    """`version` of the installed package, and in a checkout `git`: the commit of the code."""
    found = {}
    try:
        found["version"] = importlib.metadata.version("furcl")
    except importlib.metadata.PackageNotFoundError:
        found["version"] = "not installed"
    commit = code_commit(Path(__file__).parents[1])
    if commit:
        found["git"] = commit
    return found


def code_commit(root: Path) -> str | None:
    """The newest commit that changed the code of the checkout at `root`.

    Returns
    -------
    str or None     12 digits, "-dirty" behind them where CODE is changed or holds new files that
                    git does not ignore; None where `root` is no checkout or holds no such commit
    """
    if not (root / ".git").exists():
        return None
    try:
        commit = _git(root, "log", "-1", "--format=%h", "--abbrev=12", "--", *CODE)
        changed = _git(root, "status", "--porcelain", "--untracked-files=all", "--", *CODE)
    except (OSError, subprocess.SubprocessError):
        return None
    if not commit:
        return None
    return f"{commit}-dirty" if changed else commit


def _git(root: Path, *arguments: str) -> str:
    """What a git command that takes no lock says about the checkout at `root`."""
    environment = {k: v for k, v in os.environ.items() if k not in _GIT_VARIABLES}
    command = ["git", "--no-optional-locks", "-C", str(root), *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=10, check=True, env=environment
    )
    return done.stdout.strip()
