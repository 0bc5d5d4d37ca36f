"""What every benchmark writes beside its figures: who measured, where, and with which command."""

from __future__ import annotations

import json
import os
import platform
import shlex
import sys
import time
from pathlib import Path
from typing import Any

from furcl.device.choice import Device
from furcl.files import atomic_path
from furcl.version import software


def circumstances(device: Device) -> dict[str, Any]:
    """Versions, command line, machine and device of a run, as JSON values."""
    return {**command(), **place(device)}


def command() -> dict[str, Any]:
    """Versions, command line and date, as JSON values."""
    script = sys.argv[0].endswith(".py") and Path(sys.argv[0]).name != "__main__.py"
    program = ["python", sys.argv[0]] if script else ["furcl"]
    return {
        **software(),
        "command": shlex.join([*program, *sys.argv[1:]]),
        "date": time.strftime("%Y-%m-%d"),
    }


def place(device: Device) -> dict[str, Any]:
    """This machine and its device, as JSON values."""
    return {
        "machine": {
            "processor": _processor(),
            "cores": len(os.sched_getaffinity(0)),
            "system": f"{platform.system()} {platform.machine()}",
            "python": platform.python_version(),
        },
        "device": {
            "name": device.name,
            "platform": device.platform,
            "driver": device.driver_version,
        },
    }


def write_json(values: dict[str, Any], path: Path) -> None:
    """Write JSON whole or not at all; missing folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def _processor() -> str:
    """The processor's name as Linux reports it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
