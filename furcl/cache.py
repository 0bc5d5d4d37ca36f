"""Files of the cache: what can be computed again, with a digest that tells damage.

A file is the SHA-256 digest of its content, then the content. One that does not match is as one
that is not there: decoders of what is inside, and OpenCL runtimes above all, go wrong in ways of
their own on damaged input, or give other numbers.
"""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path

from furcl.files import open_regular, write_cache

log = logging.getLogger(__name__)

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
    return content


def refuse(path: Path, reason: object) -> None:
    """Log that a file of the cache is not used."""
    log.warning("%s: damaged cache file (%s); building it anew", path, reason)


def store(path: Path, content: bytes) -> None:
    """Write a file of the cache; see furcl.files.write_cache."""
    write_cache(path, lambda file: file.write_bytes(hashlib.sha256(content).digest() + content))
