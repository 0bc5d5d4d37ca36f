"""Writing files so that a reader never sees half of one."""

import logging
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

log = logging.getLogger(__name__)


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside `path`, with the same suffix, that becomes `path` on success.

    When the block raises, the temporary file is removed and an older file at `path` is kept.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(6)}{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_cache(path: Path, write: Callable[[Path], object]) -> None:
    """Have `write` make a cache file; a folder that cannot be written to is logged and no error.

    Parameters
    ----------
    write : callable    given a temporary path with the suffix of `path`
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            write(temporary)
    except OSError as error:
        _warn(path.parent, error.strerror)


@cache
def _warn(folder: Path, reason: str | None) -> None:
    """Say once a process that a folder keeps nothing."""
    log.warning(
        "%s: nothing is cached there (%s), so every start takes longer; make it writable or set "
        "FURCL_CACHE_DIR to another folder",
        folder,
        reason,
    )
