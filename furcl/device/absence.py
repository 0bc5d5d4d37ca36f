"""Why an OpenCL runtime that is installed offers no device, or none that works."""

from __future__ import annotations

import tempfile

from furcl.device.runtime_caches import pocl_cache


def pocl_cache_problem() -> tuple[str, str] | None:
    """What keeps PoCL from its cache folder, and what mends it; None if nothing does.

    Without that folder PoCL offers no device, or builds nothing.
    """
    cache = pocl_cache()
    try:
        cache.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=cache.folder, prefix=".furcl-"):
            return None
    except OSError as error:
        return (
            f"PoCL cannot write its cache folder {cache.folder} ({error.strerror})",
            f"make it writable, or set {cache.variable} to a folder that is",
        )
