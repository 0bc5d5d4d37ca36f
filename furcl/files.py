"""Files: reading regular ones only, and writing so that a reader never sees half of one."""

import errno
import hashlib
import logging
import os
import re
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

from furcl.errors import FurclError
from furcl.values import shown

# Older temporary files belong to no process that still writes them.
OLD_S = 3600.0
# Larger texts, of kernels or results, are none that furcl or a person wrote.
LARGEST_TEXT_BYTES = 1 << 28
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
# What names stand in file names with: with what is added, systems allow 255 bytes.
LONGEST_NAME = 100
_TEMPORARY = re.compile(r"\.furcl-[0-9a-f]{16}(\.\w+)?")

log = logging.getLogger(__name__)


def named(path: str | os.PathLike[str], error: type[FurclError]) -> Path:
    """A path that a file may have, there or not.

    Raises
    ------
    error       another type, a zero in it, letters that the system cannot spell, too long a name
    """
    if not isinstance(path, str | os.PathLike):
        raise error(f"path = {shown(path)}: expected the path of a file")
    path = Path(path)
    try:
        os.lstat(path)
    except ValueError as reason:
        raise error(f"path {shown(str(path))}: no file can be called so: {reason}") from None
    except OSError as reason:
        if reason.errno == errno.ENAMETOOLONG:
            raise error(f"path {shown(str(path))}: the name is too long; choose another") from None
    return path


def check_regular(path: str | os.PathLike[str]) -> None:
    """Refuse what is read without an end, or only once: all but regular files with something in
    them.

    Files of /proc say that they are empty, and reading some of them waits for ever.

    Raises
    ------
    OSError         there is none, it cannot be looked at, or is something else, which its strerror
                    says
    """
    found = Path(path).stat()
    for is_kind, name in _KINDS:
        if is_kind(found.st_mode):
            raise OSError(errno.EINVAL, f"it is {name}, not a regular file", str(path))
    if found.st_size == 0:
        raise OSError(errno.EINVAL, "it is empty", str(path))


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """A regular file, open to be read. Raises as `check_regular` and `open` do."""
    check_regular(path)
    return Path(path).open("rb")


def read_text(path: str | os.PathLike[str]) -> str:
    """The UTF-8 text of a regular file, without a byte order mark.

    Raises
    ------
    OSError         as `check_regular`; more than LARGEST_TEXT_BYTES
    ValueError      another encoding
    """
    with open_regular(path) as file:
        data = file.read(LARGEST_TEXT_BYTES + 1)
    if len(data) > LARGEST_TEXT_BYTES:
        raise OSError(errno.EFBIG, f"it has more than {LARGEST_TEXT_BYTES} bytes", str(path))
    return data.decode("utf-8-sig")


def file_name(text: str) -> str:
    """A text as a part of a file's name, or of a key: another one for every other text.

    Letters of ASCII, digits, spaces and _ + - . ( ) = ~ stay; all others, and a point at the
    beginning, are %XX, and what is longer than 100 letters ends with its digest.
    """
    name = quote(text, safe=" +()=")
    if name.startswith("."):
        name = "%2E" + name[1:]
    if len(name) > LONGEST_NAME:
        name = f"{name[: LONGEST_NAME - 21]}%{hashlib.sha256(text.encode()).hexdigest()[:20]}"
    return name


def is_file(path: str | os.PathLike[str]) -> bool:
    """Whether there is a file of that name; of a name that cannot be one there is none."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside `path`, with the same suffix, that becomes `path` on success.

    When the block raises, the temporary file is removed and an older file at `path` is kept. Errors
    of the system, and furcl's, name `path`, not the temporary file. Of a link, the file that it
    leads to is replaced.
    """
    named_path, path = Path(path), Path(os.path.realpath(path))
    _remove_old(path.parent)
    temporary = path.with_name(f".furcl-{secrets.token_hex(8)}{named_path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and str(error.filename) == str(temporary):
            error.filename, error.filename2 = str(named_path), None
        if isinstance(error, FurclError):
            text = str(error).replace(str(temporary), str(named_path))
            raise type(error)(text) from error.__cause__
        raise


@cache
def _remove_old(folder: Path) -> None:
    """Remove, once a process, temporary files that killed processes left in a folder long ago."""
    try:
        for path in folder.glob(".furcl-*"):
            if _TEMPORARY.fullmatch(path.name) and time.time() - path.stat().st_mtime > OLD_S:
                path.unlink()
                log.info("removed %s, which a process left that was killed", path)
    except OSError:  # another process was quicker, or the folder cannot be read
        pass


def check_writable(path: str | os.PathLike[str], error: type[FurclError]) -> None:
    """Refuse a path that could not be written to later; makes its folder.

    Raises
    ------
    error       no file can be called so, what is there is no file or read-only, or its folder
                cannot be written to
    """
    path = named(path, error)
    if path.is_dir():
        raise error(f"{path}: is a folder; give the name of a file")
    if path.exists() and not path.is_file():
        raise error(f"{path}: is no regular file, which would be replaced; give another name")
    if path.exists() and not os.access(path, os.W_OK):
        raise error(f"{path}: is read-only; make it writable or give another name")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        probe = path.with_name(f".furcl-{secrets.token_hex(8)}{path.suffix}")
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as reason:
        raise error(
            f"{path}: cannot be written: {reason.strerror}; check the folder, its rights and the "
            f"space left"
        ) from None


def write_cache(path: Path, write: Callable[[Path], object]) -> None:
    """Have `write` make a cache file; where that is not possible it is logged and no error.

    Parameters
    ----------
    write : callable    given a temporary path with the suffix of `path`
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            write(temporary)
    except (OSError, FurclError) as error:
        _warn(path.parent, getattr(error, "strerror", None) or str(error))


@cache
def _warn(folder: Path, reason: str | None) -> None:
    """Say once a process that a folder keeps nothing."""
    log.warning(
        "%s: nothing is cached there (%s), so every start takes longer; make it writable or set "
        "FURCL_CACHE_DIR to another folder",
        folder,
        reason,
    )
