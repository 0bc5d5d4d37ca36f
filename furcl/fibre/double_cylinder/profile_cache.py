"""Profiles on disk: found by content, replaced whole, never trusted blindly."""

from __future__ import annotations

import hashlib
import json
import logging
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from furcl.files import write_cache
from furcl.paths import cache_folder

log = logging.getLogger(__name__)


def cache_path(content: dict[str, Any]) -> Path:
    """The file for tables that are made from `content` (plain values)."""
    text = json.dumps(content, sort_keys=True)
    return cache_folder() / "medulla" / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"


def load(path: Path, shapes: dict[str, tuple[int, ...]]) -> dict[str, np.ndarray] | None:
    """The arrays of a file, or None if it is absent, damaged or not of these shapes."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        log.warning("%s: damaged cache file (%s); building it anew", path, error)
        return None
    found = {name: array.shape for name, array in arrays.items()}
    if found != shapes or not all(np.isfinite(a).all() for a in arrays.values()):
        log.warning("%s: cache file with other content; building it anew", path)
        return None
    return arrays


def store(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a file; see furcl.files.write_cache."""
    write_cache(path, lambda file: np.savez(file, **arrays))  # pyright: ignore[reportArgumentType]
