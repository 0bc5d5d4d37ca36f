"""Does a device pass the self-test? Asked in a process of its own; a success is remembered.

Some OpenCL runtimes end the whole process when their compiler meets a CPU that it does not know,
so the first test of a device never runs in the process that wants to render. A failure is not
remembered: what caused it may be over.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path

from furcl import cache
from furcl.device.build_errors import DOES_NOT_COMPILE, names_a_place
from furcl.device.features import Features
from furcl.device.source import kernel_text
from furcl.paths import cache_folder, module_environment, python_command

TIMEOUT_S = 180.0
EXIT_FAILED = 10  # a self-test that ran and failed ends with this code

# What in the output of a failed test stands for what, in plain words.
_EXPLANATIONS = (
    (
        "unknown target CPU",
        "its compiler (LLVM) is older than this CPU; a newer OpenCL runtime is needed",
    ),
    (
        'Executable "ld" doesn\'t exist',
        "it needs the linker ld, which no folder of PATH holds: the package binutils has it",
    ),
    (
        "No space left on device",
        "a disk is full, of its cache or temporary folder: make room, or set POCL_CACHE_DIR",
    ),
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
    runtime_failed : bool   it crashed, or did not compile through no fault of the kernels, and no
                        reason is known
    """

    passed: bool
    reason: str = ""
    log: str = ""
    runtime_failed: bool = False


def explain(output: str, code: int) -> str:
    """One line of plain words for what a failed self-test printed and the code it ended with."""
    for sign, words in _EXPLANATIONS:
        if sign in output:
            return words
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    last = lines[-1].rstrip(".") if lines else "it printed nothing"
    if code < 0:
        return f"it ends the process with {signal.Signals(-code).name}: {last}"
    if any(line.startswith("Traceback (most recent call last)") for line in lines):
        return last
    errors = [line for line in lines if "error:" in line]
    if not errors and lines and DOES_NOT_COMPILE in lines[0]:
        return f"{lines[0].partition(DOES_NOT_COMPILE)[0]}{DOES_NOT_COMPILE}, no reason is given"
    return (errors or lines or [last])[0]


def runtime_failed(output: str, code: int) -> bool:
    """Whether a failed self-test ended so for no reason that lies in the kernels or is known."""
    if any(sign in output for sign, _ in _EXPLANATIONS):
        return False
    return code < 0 or (DOES_NOT_COMPILE in output and not names_a_place(output))


def _text_hash() -> str:
    """Of all that the self-test does: its kernels and what compares their results."""
    script = Path(__file__).with_name("selftest.py").read_text(encoding="utf-8")
    text = kernel_text("tools/selftest.cl", Features())
    return hashlib.sha256((text + script).encode()).hexdigest()


def _run(address: str) -> Verdict:
    command = python_command("-m", "furcl.device.selftest", address)
    try:
        done = subprocess.run(
            command,
            # What PoCL built before says nothing about building now.
            env=module_environment(POCL_KERNEL_CACHE="0"),
            capture_output=True,
            text=True,
            encoding="utf-8",
            errors="replace",
            timeout=TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        return Verdict(False, f"its self-test did not end in {TIMEOUT_S:.0f} s")
    except OSError as error:
        return Verdict(False, f"its self-test cannot start: {error.strerror}")
    output = done.stdout + done.stderr
    if done.returncode == 0:
        return Verdict(True)
    return Verdict(
        False,
        explain(output, done.returncode),
        output[-8000:],
        runtime_failed=runtime_failed(output, done.returncode),
    )


def _surroundings() -> str:
    """What of the environment may decide whether a runtime works: folders, settings, a linker."""
    names = ("HOME", "XDG_CACHE_HOME", "TMPDIR", "LD_LIBRARY_PATH")
    told = [n for n in sorted(os.environ) if n in names or n.startswith(("POCL_", "CL_", "OCL_"))]
    return repr([(name, os.environ[name]) for name in told] + [("ld", shutil.which("ld"))])


def of(address: str, identity: str, *, fresh: bool = False) -> Verdict:
    """The verdict on a device.

    Parameters
    ----------
    address : str       "P:D", platform and device number
    identity : str      everything that tells this device and driver from others
    fresh : bool        test again, whatever the cache says

    That a device passed is remembered until the device, its driver, the text of the self-test or
    what the runtime needs of the environment changes.
    """
    told = f"{identity}\n{_text_hash()}\n{_surroundings()}"
    # Names of folders may be no UTF-8.
    key = hashlib.sha256(told.encode("utf-8", "surrogateescape")).hexdigest()
    path = cache_folder() / "selftest" / f"{key[:24]}.passed"
    if not fresh and cache.load(path) == key.encode():
        return Verdict(True)
    verdict = _run(address)
    if verdict.passed:
        cache.store(path, key.encode())
    return verdict
