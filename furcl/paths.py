"""Where furcl's own files are: kernels, the scenes that come with it, its cache, and its Python."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import platformdirs


def _data_folder(name: str) -> Path:
    packaged = Path(__file__).parent / name
    return packaged if packaged.is_dir() else Path(__file__).parents[1] / name


def kernel_folder() -> Path:
    """Where the .cl files are: beside this file in a wheel, at the root in a checkout."""
    return _data_folder("kernels")


def scene_folder() -> Path:
    """Where the scenes that come with furcl are, found as `kernel_folder` is."""
    return _data_folder("scenes")


def cache_folder() -> Path:
    """The folder for what can be computed again: FURCL_CACHE_DIR or the user's cache folder."""
    return Path(os.environ.get("FURCL_CACHE_DIR") or platformdirs.user_cache_dir("furcl"))


def module_environment(**changes: str) -> dict[str, str]:
    """The environment for `python_command("-m", ...)` with a module of furcl, wherever it lies."""
    folders = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, folders)), **changes}


def python_command(*arguments: str) -> list[str]:
    """A command that runs this Python, and no module that lies in the working folder.

    That folder may be a downloaded scene's, with a file numpy.py in it.
    """
    return [sys.executable, "-P", *arguments]
