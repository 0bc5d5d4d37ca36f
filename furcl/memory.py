"""Memory of this process, asked for before a file is decoded that claims much of it."""

from __future__ import annotations

import os
import re
import resource
from pathlib import Path

from furcl.errors import FurclError

# Libraries, the OpenCL runtime and its compiler take as much before a scene is there. With less,
# threads of the runtime may wait for ever.
ADDRESS_SPACE_BYTES = 950 << 20
# Stacks and heaps of the threads of a library are counted when they are reserved.
THREAD_BYTES = 16 << 20
SLACK_BYTES = 64 << 20


def available_bytes() -> int:
    """What this process can still allocate [bytes]: memory of the machine, within its limit.

    The limit is that of the address space (ulimit -v). What cannot be found out does not count.
    """
    free = 1 << 62
    try:
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
        facts = dict(line.split(":", 1) for line in lines if ":" in line)
        free = int(facts["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        pass
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY:
        try:
            used = int(
                Path("/proc/self/statm").read_text(encoding="utf-8").split()[0]
            ) * os.sysconf("SC_PAGE_SIZE")
        except (OSError, ValueError):
            used = 0
        free = min(free, max(limit - used, 0))
    return free


def little_address_space() -> str:
    """What to say where this process may have less address space than furcl needs; else ""."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY or limit >= ADDRESS_SPACE_BYTES:
        return ""
    return (
        f"this process may use {limit / 2**20:.0f} MiB of address space, furcl needs "
        f"{ADDRESS_SPACE_BYTES / 2**20:.0f}; raise the limit: ulimit -v"
    )


def require_memory(path: str | Path, n_bytes: int, error: type[FurclError]) -> None:
    """Refuse a file whose decoding takes more memory than there is.

    Raises
    ------
    error       names the file, what it needs and what is there
    """
    available = available_bytes()
    if n_bytes > available:
        raise error(
            f"{path}: needs {n_bytes / 2**20:.0f} MiB to be read; {available / 2**20:.0f} MiB of "
            f"memory are available. Use a smaller file, or raise the limit (ulimit -v)."
        )


def limit_memory(n_bytes: int) -> None:
    """Let this process take so much more data, beside the stacks of a library's threads."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    found = re.search(r"VmData:\s*(\d+) kB", status)
    if found is None:
        return
    limit = 1024 * int(found[1]) + n_bytes + SLACK_BYTES + THREAD_BYTES * (os.cpu_count() or 1)
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    if hard != resource.RLIM_INFINITY:
        limit = min(limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
