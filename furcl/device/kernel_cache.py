"""Built kernels kept on disk, for runtimes that keep none themselves.

PoCL has a cache of its own, keyed by the text that it is given, and compiles everything twice when
it is asked for binaries; there this one stays out of the way.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import pyopencl as cl
from pyopencl import _cl

from furcl import cache
from furcl.device.choice import Device
from furcl.errors import KernelBuildError
from furcl.paths import cache_folder

log = logging.getLogger(__name__)

OWN_CACHE_PLATFORMS = ("Portable Computing Language",)


def cache_key(device: Device, text: str, options: Sequence[str]) -> str:
    """What decides a binary: text with its defines and includes, device, driver and options."""
    parts = (text, device.name, device.platform, device.driver_version, *options)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def binary_path(device: Device, text: str, options: Sequence[str]) -> Path | None:
    """Where the binary of a text is or would be; None where the runtime has its own cache."""
    if device.platform.startswith(OWN_CACHE_PLATFORMS):
        return None
    return cache_folder() / "kernels" / f"{cache_key(device, text, options)}.bin"


def built(raw: _cl._Program, options: Sequence[str]) -> cl.Program:
    """A program of pyopencl's lower layer, built for its context.

    The upper layer makes a Python warning of whatever a compiler says although it succeeds
    (Intel's says "done"). A filter for that would change the caller's process, and so would
    catching it while other threads warn.

    Raises
    ------
    KernelBuildError    if it does not compile, with what the compiler says
    """
    try:
        raw._build(" ".join(options).encode(), None)
    except cl.Error as error:
        said = "\n".join(text for _, text in raw._get_build_logs() if text)
        raise KernelBuildError(f"{error}\n{said}".strip()) from error
    return cl.Program(raw)


def load(device: Device, path: Path | None, options: Sequence[str]) -> cl.Program | None:
    """The program of a cached binary; None if there is none that the runtime takes.

    Runtimes may crash on a damaged binary, so its digest matters.
    """
    binary = cache.load(path) if path else None
    if path is None or binary is None:
        return None
    try:
        return built(_cl._Program(device.context, [device.cl_device], [binary]), options)
    except (cl.Error, KernelBuildError) as error:
        cache.refuse(path, error)
        return None


def store(program: cl.Program, path: Path | None) -> None:
    """Keep the binary of a program, where the runtime gives it; see furcl.cache.store."""
    if path is None:
        return
    try:
        (binary,) = cast("list[bytes]", program.get_info(cl.program_info.BINARIES))
    except cl.Error as error:
        log.info("%s: kernels not cached: %s", path, error)
        return
    cache.store(path, binary)
