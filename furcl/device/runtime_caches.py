"""Caches in which OpenCL runtimes keep what they build, and which they trust.

A runtime may crash, or fail to build, where a file of its cache is damaged or where the cache is
removed while it builds. Nothing here opens them.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

POCL = "Portable Computing Language"
NVIDIA = "NVIDIA CUDA"


@dataclass(frozen=True)
class RuntimeCache:
    """Where a runtime keeps its cache, by the environment.

    Attributes
    ----------
    short_name : str    of the runtime
    folder : Path
    variable : str      the environment variable that names another folder
    """

    short_name: str
    folder: Path
    variable: str

    @property
    def advice(self) -> str:
        """What to do about a crash or a failed build that the cache may be the cause of."""
        return (
            f"{self.short_name} may do so where its own cache, which it does not check, is damaged "
            f"or was removed meanwhile: if it happens again, remove {self.folder}, or let "
            f"{self.variable} name another folder"
        )


def pocl_cache() -> RuntimeCache:
    """PoCL's."""
    home = os.environ.get("HOME")
    base = os.environ.get("XDG_CACHE_HOME") or (f"{home}/.cache" if home else "/tmp")
    named = os.environ.get("POCL_CACHE_DIR") or f"{base}/pocl/kcache"
    return RuntimeCache("PoCL", Path(named), "POCL_CACHE_DIR")


def cache_of(runtime: str) -> RuntimeCache | None:
    """The cache of the runtime whose platform is called so; None where none is known."""
    if runtime.startswith(POCL):
        return pocl_cache()
    if runtime.startswith(NVIDIA):
        named = os.environ.get("CUDA_CACHE_PATH") or Path.home() / ".nv" / "ComputeCache"
        return RuntimeCache("NVIDIA's runtime", Path(named), "CUDA_CACHE_PATH")
    return None
