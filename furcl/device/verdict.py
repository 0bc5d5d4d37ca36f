"""Does a device pass the self-test? Asked in a process of its own, remembered in the cache folder.

Some OpenCL runtimes end the whole process when their compiler meets a CPU that it does not know,
so the first test of a device never runs in the process that wants to render.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
from dataclasses import asdict, dataclass
from pathlib import Path

from furcl.device.features import Features
from furcl.device.source import kernel_text
from furcl.files import write_cache
from furcl.paths import cache_folder, python_command

TIMEOUT_S = 180.0
EXIT_FAILED = 10  # a self-test that ran and failed ends with this code

# What in the output of a failed test stands for what, in plain words.
_EXPLANATIONS = (
    (
        "unknown target CPU",
        "its compiler (LLVM) is older than this CPU; a newer OpenCL runtime is needed",
    ),
    (
        "changes the ABI",  # of a vector: the CPU's name did not tell the compiler what it can
        "its compiler (LLVM) does not know this CPU's vectors; a newer OpenCL runtime is needed",
    ),
    ('Executable "ld" doesn\'t exist', "it needs the linker ld: install the package binutils"),
    ("OUT_OF_HOST_MEMORY", "it ran out of memory"),
    ("COMPILER_NOT_AVAILABLE", "it comes without a compiler"),
    ("INVALID_DEVICE", "it no longer exists"),
)


@dataclass(frozen=True)
class Verdict:
    """Outcome of a self-test.

    Attributes
    ----------
    passed : bool
    reason : str        one line on why it failed
    log : str           the end of what it printed
    lasting : bool      it will come out the same until device, driver or self-test change
    """

    passed: bool
    reason: str = ""
    log: str = ""
    lasting: bool = True


def explain(output: str, code: int) -> str:
    """One line of plain words for what a failed self-test printed and the code it ended with."""
    for sign, words in _EXPLANATIONS:
        if sign in output:
            return words
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    last = lines[-1].rstrip(".") if lines else "it printed nothing"
    if code < 0:
        return f"it ends the process with {signal.Signals(-code).name}: {last}"
    errors = [line for line in lines if "error:" in line]
    return (errors or lines or [last])[0]


def _text_hash() -> str:
    """Of all that the self-test does: its kernels and what compares their results."""
    script = Path(__file__).with_name("selftest.py").read_text()
    text = kernel_text("tools/selftest.cl", Features())
    return hashlib.sha256((text + script).encode()).hexdigest()


def _run(address: str) -> Verdict:
    command = python_command("-m", "furcl.device.selftest", address)
    folders = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, folders))}
    try:
        done = subprocess.run(
            command,
            env=environment,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        return Verdict(False, f"its self-test did not end in {TIMEOUT_S:.0f} s", lasting=False)
    output = done.stdout + done.stderr
    if done.returncode == 0:
        return Verdict(True)
    lasting = done.returncode == EXIT_FAILED or done.returncode < 0
    return Verdict(False, explain(output, done.returncode), output[-8000:], lasting)


def of(address: str, identity: str, *, fresh: bool = False) -> Verdict:
    """The verdict on a device.

    Parameters
    ----------
    address : str       "P:D", platform and device number
    identity : str      everything that tells this device and driver from others
    fresh : bool        test again, whatever the cache says

    The cached verdict holds until the device, its driver or the text of the self-test changes.
    A test that timed out or could not start is not remembered.
    """
    key = hashlib.sha256(f"{identity}\n{_text_hash()}".encode()).hexdigest()[:24]
    path = cache_folder() / "selftest" / f"{key}.json"
    if not fresh:
        try:
            return Verdict(**json.loads(path.read_text()))
        except (OSError, ValueError, TypeError):
            pass  # none yet, or unreadable: test again
    verdict = _run(address)
    if verdict.lasting:
        text = json.dumps(asdict(verdict))
        write_cache(path, lambda file: file.write_text(text))
    return verdict
