"""OpenEXR files to damage, and a way to read thousands of them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from faults.harness import in_fork
from furcl.image.exr_decode import MEMORY_FACTOR, Planes, decode
from furcl.memory import limit_memory

COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA", "DWAB")
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


@cache
def seed(compression: str, folder: Path) -> bytes:
    """A whole file, written by a process of its own: the library starts threads for it."""
    path = folder / "seed.exr"
    child = os.fork()
    if not child:
        code = 1
        try:
            _write(compression, path)
            code = 0
        finally:
            os._exit(code)
    assert not os.waitpid(child, 0)[1]
    return path.read_bytes()


def _write(compression: str, path: Path) -> None:
    import OpenEXR

    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    pixels = np.random.default_rng(1).random((12, 17, 3))
    pixels[3:7] = 0.5  # what packs
    header = {"compression": kind, "type": OpenEXR.scanlineimage, "chromaticities": REC709}
    with OpenEXR.File(header, {"RGB": pixels.astype(np.float32)}) as file:
        file.write(str(path))


def by_fork(path: Path, names: Sequence[str], shape: tuple[int, int]) -> Planes:
    """As furcl.image.exr_decode.decode_apart, but by a fork of this process, which has loaded the
    library: that is ten times faster than another process."""
    import mmap

    import OpenEXR  # noqa: F401

    count = (len(names), *shape)
    n_bytes = 4 * len(names) * shape[0] * shape[1]
    shared = mmap.mmap(-1, n_bytes)
    planes = np.frombuffer(shared, np.float32).reshape(count)

    def within_limits() -> None:
        limit_memory(MEMORY_FACTOR * n_bytes)
        decode(path, names, planes)

    status = in_fork(within_limits)
    if status:
        raise ValueError(f"the OpenEXR library ends with {os.waitstatus_to_exitcode(status)}")
    return planes
