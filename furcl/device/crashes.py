"""A process that crashes cannot say why. The next one says that it did, and what may mend it."""

from __future__ import annotations

import faulthandler
import logging
import os
import re
from contextlib import suppress
from pathlib import Path
from typing import IO

from furcl.device.runtime_caches import cache_of, pocl_cache
from furcl.paths import cache_folder

log = logging.getLogger(__name__)

_REASON = re.compile(r"^Fatal Python error: (.+)", re.MULTILINE)
_RUNTIME = re.compile(r"^runtime: (.+)", re.MULTILINE)

# Of this process; the handler of Python keeps no reference.
_record: IO[str] | None = None


def watch() -> None:
    """From here on a signal that ends the process by a crash leaves a record in the cache folder.

    Records of processes that are gone are told as warnings, once. Where Python's own handler is
    switched on, or the folder cannot be written to, nothing is done.
    """
    global _record
    folder = cache_folder() / "crashes"
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        for path in folder.glob("*.txt"):
            if path.stem == str(os.getpid()) or not _runs(path.stem):
                _tell(path)
        if not faulthandler.is_enabled():
            _record = (folder / f"{os.getpid()}.txt").open("w", encoding="utf-8")
            faulthandler.enable(_record, all_threads=False)


def renew(runtime: str) -> None:
    """Watch again, after a runtime is loaded, whose name is recorded: LLVM puts handlers of its own
    before, which end the process when it aborts."""
    if _record is not None:
        faulthandler.disable()
        with suppress(OSError):  # a full disk
            _record.write(f"runtime: {runtime}\n")
            _record.flush()
        faulthandler.enable(_record, all_threads=False)


def forget() -> None:
    """The process ends in good order."""
    global _record
    if _record is None:
        return
    faulthandler.disable()
    _record.close()
    with suppress(OSError):
        Path(_record.name).unlink()
    _record = None


def _runs(pid: str) -> bool:
    try:
        os.kill(int(pid), 0)
    except (ValueError, OverflowError, ProcessLookupError):
        return False
    except PermissionError:  # another user's
        return True
    return True


def _tell(path: Path) -> None:
    with path.open(encoding="utf-8", errors="replace") as file:
        text = file.read(4000)
    path.unlink()
    found, runtime = _REASON.search(text), _RUNTIME.findall(text)
    if found:  # else it was killed, or the machine went down
        cache = cache_of(runtime[-1]) if runtime else pocl_cache()
        advice = f". {cache.advice}" if cache else ""
        log.warning(
            "an earlier run crashed (%s). Mostly a runtime of OpenCL did%s", found[1], advice
        )
