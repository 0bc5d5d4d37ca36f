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

from furcl.device.choice import Device
from furcl.files import write_cache
from furcl.paths import cache_folder

log = logging.getLogger(__name__)

DIGEST_BYTES = hashlib.sha256().digest_size
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
    cl.Error    if it does not compile, with what the compiler says
    """
    try:
        raw._build(" ".join(options).encode(), None)
    except cl.Error as error:
        raise cl.RuntimeError(f"{error}\n{_build_log(raw)}") from error
    return cl.Program(raw)


def _build_log(raw: _cl._Program) -> str:
    devices = cast("list[cl.Device]", raw.get_info(cl.program_info.DEVICES))
    logs = [str(raw.get_build_info(device, cl.program_build_info.LOG)) for device in devices]
    return "\n".join(log.strip() for log in logs)


def load(device: Device, path: Path | None, options: Sequence[str]) -> cl.Program | None:
    """The program of a cached binary; None if there is none that the runtime takes.

    Runtimes may crash on a damaged binary, so it is checked against its digest first.
    """
    if path is None or not path.is_file():
        return None
    try:
        content = path.read_bytes()
        digest, binary = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
        if hashlib.sha256(binary).digest() != digest:
            log.warning("%s: damaged; building again", path)
            return None
        return built(_cl._Program(device.context, [device.cl_device], [binary]), options)
    except (OSError, cl.Error) as error:
        log.warning("%s: not usable (%s); building again", path, error)
        return None


def store(program: cl.Program, path: Path | None) -> None:
    """Keep the binary of a program, where the runtime gives it; see furcl.files.write_cache."""
    if path is None:
        return
    try:
        (binary,) = cast("list[bytes]", program.get_info(cl.program_info.BINARIES))
    except cl.Error as error:
        log.info("%s: kernels not cached: %s", path, error)
        return
    content = hashlib.sha256(binary).digest() + binary
    write_cache(path, lambda file: file.write_bytes(content))
