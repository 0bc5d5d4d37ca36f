"""Where furcl's own files are: kernels, the scenes that come with it, and its cache."""

from __future__ import annotations

import os
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
