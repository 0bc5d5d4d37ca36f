"""The pixels of an OpenEXR file by the OpenEXR library, here or in a process of its own.

The library writes to standard output and error, may take many times what a picture takes, and is
the one part that meets what a damaged file says. So a file that is not known to be whole is decoded
by another process, `python -m furcl.image.exr_decode`, whose output is caught and whose memory is
limited; it writes the pixels into memory that both share. Starting it takes a tenth of a second.
"""

from __future__ import annotations

import json
import mmap
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from furcl.memory import limit_memory
from furcl.paths import module_environment, python_command

Planes = NDArray[np.float32]

# Of decoded pixels, beside what the process takes anyway: the library's channels, and chunks.
MEMORY_FACTOR = 3


def decode(path: Path, names: Sequence[str], planes: Planes) -> None:
    """Fill planes (channel, row, column) with the channels of the first part, by this process.

    Raises
    ------
    ValueError      the library fails, or finds other channels or sizes; what it says
    """
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            for name, plane in zip(names, planes, strict=True):
                plane[...] = channels.pop(name).pixels
    except MemoryError:
        raise
    except Exception as error:  # the library raises many kinds
        raise ValueError(str(error)) from None


def decode_apart(path: Path, names: Sequence[str], shape: tuple[int, int]) -> Planes:
    """The channels of the first part as planes (channel, row, column), by another process.

    Raises
    ------
    ValueError      as `decode`; the process cannot be started, crashes or takes too much memory
    """
    count = (len(names), *shape)
    n_bytes = 4 * len(names) * shape[0] * shape[1]
    file = os.memfd_create("furcl-exr", os.MFD_CLOEXEC)
    try:
        os.ftruncate(file, n_bytes)
        request = json.dumps([str(path), file, list(names), list(shape)])
        command = python_command("-m", "furcl.image.exr_decode", request)
        ended = subprocess.run(
            command,
            env=module_environment(OPENBLAS_NUM_THREADS="1"),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=(file,),
            check=False,
        )
        if ended.returncode != 0:
            raise ValueError(_reason(ended.stdout.decode("utf-8", "replace"), ended.returncode))
        shared = mmap.mmap(file, n_bytes)
    except OSError as error:
        raise ValueError(f"no process can decode it: {error.strerror}") from None
    finally:
        os.close(file)
    return np.frombuffer(shared, np.float32).reshape(count)


def _reason(said: str, code: int) -> str:
    """What the library wrote, without the file's name; or how its process ended."""
    if "MemoryError" in said or "bad_alloc" in said:
        return f"it takes more than {MEMORY_FACTOR + 1} times the memory of its pixels"
    for sign in (r"\(EXR_ERR_\w+\) (.+)", r"Exception raised reading pixel data for part 0 - (.+)"):
        found = re.search(sign, said)
        if found:
            return found[1]
    if code < 0:
        return f"the OpenEXR library crashes on it (signal {-code})"
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    return (
        lines[-1].removeprefix("ValueError: ") if lines else "the OpenEXR library does not say why"
    )


def main(request: str) -> int:
    """Decode what a request of `decode_apart` names; print what fails and return 1."""
    path, file, names, shape = json.loads(request)
    n_bytes = 4 * len(names) * shape[0] * shape[1]
    planes = np.frombuffer(mmap.mmap(file, n_bytes), np.float32).reshape(len(names), *shape)
    import OpenEXR  # noqa: F401  # before its memory is limited

    limit_memory(MEMORY_FACTOR * n_bytes)
    try:
        decode(Path(path), names, planes)
    except (MemoryError, ValueError) as error:
        print(f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
