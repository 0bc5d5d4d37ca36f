"""Small git repositories for tests of what commits are named."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

_NOBODY = {
    f"GIT_{who}_{what}": value
    for who in ("AUTHOR", "COMMITTER")
    for what, value in (("NAME", "nobody"), ("EMAIL", "nobody@example.org"))
}


def git(root: Path, *arguments: str) -> str:
    """Run git in `root`, with no configuration but the repository's own; what it printed."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    plain = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
    done = subprocess.run(
        ["git", "-C", str(root), *arguments],
        env={**kept, **plain, **_NOBODY},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def commit(root: Path, *paths: str) -> str:
    """Add a line to each file and commit; the 12 digits of the commit."""
    for path in paths:
        write(root, path)
    git(root, "add", *paths)
    git(root, "commit", "--quiet", "-m", ", ".join(paths))
    return git(root, "rev-parse", "--short=12", "HEAD")


def write(root: Path, path: str) -> None:
    """Add a line to a file."""
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    with (root / path).open("a") as file:
        file.write("a line\n")
