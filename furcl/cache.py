"""Files of the cache: what can be computed again, with a digest that tells damage.

A file is the SHA-256 digest of its content, then the content. One that does not match is as one
that is not there: decoders of what is inside, and OpenCL runtimes above all, go wrong in ways of
their own on damaged input, or give other numbers.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import time
from pathlib import Path

from furcl.files import open_regular, write_cache

log = logging.getLogger(__name__)

#: Of one folder: tables of medullas are 0.2 MB each, kernels mostly less than 1 MB.
MOST_FILES = 400

DIGEST_BYTES = hashlib.sha256().digest_size


def load(path: Path) -> bytes | None:
    """The content of a file of the cache; None if there is none, or it is damaged, which is logged.

    Whoever finds a content unusable all the same calls `refuse`.
    """
    try:
        with open_regular(path) as file:
            digest, content = file.read(DIGEST_BYTES), file.read()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        refuse(path, error.strerror or str(error))
        return None
    if hashlib.sha256(content).digest() != digest:
        refuse(path, "its content does not match its digest")
        return None
    with contextlib.suppress(OSError):
        os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))
    return content


def refuse(path: Path, reason: object) -> None:
    """Log that a file of the cache is not used."""
    log.warning("%s: damaged cache file (%s); building it anew", path, reason)


def store(path: Path, content: bytes) -> None:
    """Write a file of the cache; see furcl.files.write_cache. Its folder keeps the MOST_FILES of
    its kind that were written or loaded last."""
    write_cache(path, lambda file: file.write_bytes(hashlib.sha256(content).digest() + content))
    with contextlib.suppress(OSError):
        files = sorted(path.parent.glob(f"*{path.suffix}"), key=_last_used)
        for file in files[:-MOST_FILES]:
            file.unlink()


def _last_used(path: Path) -> float:
    found = path.stat()
    return max(found.st_atime, found.st_mtime)
