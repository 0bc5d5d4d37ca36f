"""What is wrong with this installation, and the command that mends it."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from furcl.install import provision
from furcl.paths import cache_folder, kernel_folder, python_command

SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
PROVISION = "python -m furcl.install.provision"
CPU_RUNTIME = f"{PROVISION}; or as root: {provision.DEBIAN_COMMAND}"


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    Attributes
    ----------
    level : str     "ok", "warning" (furcl works without it) or "error"
    what : str      what was looked at
    found : str     what was found
    remedy : str    what mends it; empty when all is well
    """

    level: str
    what: str
    found: str
    remedy: str = ""


def _check_python() -> Iterator[Finding]:
    yield Finding("ok", "Python", f"{platform.python_version()} in {sys.prefix}")
    try:
        yield Finding("ok", "pyopencl", metadata.version("pyopencl"))
    except metadata.PackageNotFoundError:
        yield Finding("error", "pyopencl", "not installed", "pip install pyopencl")


def _check_files() -> Iterator[Finding]:
    folder = kernel_folder()
    if (folder / "tools/selftest.cl").is_file():
        yield Finding("ok", "kernels", str(folder))
    else:
        yield Finding("error", "kernels", f"none in {folder}", "install furcl again")
    cache = cache_folder()
    try:
        cache.mkdir(parents=True, exist_ok=True)
        writable = os.access(cache, os.W_OK)
    except OSError:
        writable = False
    if writable:
        yield Finding("ok", "cache folder", str(cache))
    else:
        remedy = "set FURCL_CACHE_DIR to a folder that can be written"
        yield Finding("warning", "cache folder", f"{cache} cannot be written: slow starts", remedy)


def _check_embree() -> Iterator[Finding]:
    spec = find_spec("embreex")
    if spec is None or spec.origin is None:
        yield Finding("error", "Embree", "embreex is not installed", "pip install embreex")
        return
    libraries = Path(spec.origin).parents[1] / "embreex.libs"
    found = sorted(libraries.glob("libembree4*"))
    if found:
        yield Finding("ok", "Embree", found[0].name)
    else:
        remedy = "pip install --force-reinstall --only-binary :all: embreex"
        yield Finding("error", "Embree", f"no libembree4 in {libraries}", remedy)


def vendor_folders() -> list[Path]:
    """Where the OpenCL loader looks for .icd files, in order."""
    named = os.environ.get("OCL_ICD_VENDORS") or os.environ.get("OPENCL_VENDOR_PATH")
    own = provision.loader_folder()
    return [Path(named) if named else SYSTEM_VENDORS, *([own] if own else [])]


def _check_environment() -> Iterator[Finding]:
    for name in ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"):
        value = os.environ.get(name)
        if not value:
            continue
        path = Path(value)
        if not path.exists():
            found = f"names {value}, which does not exist: no OpenCL runtime is found at all"
            yield Finding("error", name, found, f"unset {name}")
        elif path.is_dir() and not any(path.glob("*.icd")):
            found = f"names {value}, which holds no .icd file; {SYSTEM_VENDORS} is not read"
            yield Finding("warning", name, found, f"unset {name}")


def _check_runtimes() -> Iterator[Finding]:
    for folder in vendor_folders():
        for icd in sorted(folder.glob("*.icd")) if folder.is_dir() else ():
            library = icd.read_text(encoding="utf-8", errors="replace").strip()
            if library.startswith("/") and not Path(library).exists():
                found = f"names {library}, which does not exist"
                remedy = PROVISION if folder != SYSTEM_VENDORS else "reinstall that runtime"
                yield Finding("warning", str(icd), found, remedy)
            else:
                yield Finding("ok", str(icd), library)
    registration = provision.intel_registration()
    if provision.intel_library() and registration and not registration.exists():
        found = "installed, but the OpenCL loader does not know it"
        yield Finding("warning", "intel-opencl-rt", found, f"{PROVISION} --add intel")
    if Path("/proc/driver/nvidia/version").exists() and not any(
        "nvidia" in icd.name.lower() for folder in vendor_folders() for icd in folder.glob("*.icd")
    ):
        remedy = "as root: apt-get install nvidia-opencl-icd"
        yield Finding("warning", "NVIDIA GPU", "its OpenCL runtime is not installed", remedy)


def _check_devices() -> Iterator[Finding]:
    # A runtime that ends the process when asked for its devices must not end the doctor.
    count = "import pyopencl as cl; print([len(p.get_devices()) for p in cl.get_platforms()])"
    done = subprocess.run(
        python_command("-c", count), capture_output=True, text=True, errors="replace"
    )
    if done.returncode < 0:
        found = f"asking for the devices ends the process with signal {-done.returncode}"
        yield Finding("error", "OpenCL", found, "remove the runtime listed last above")
        return
    if "PLATFORM_NOT_FOUND" in done.stderr:
        yield Finding(
            "error", "OpenCL", "no platform: no runtime is installed or found", CPU_RUNTIME
        )
        return

    from furcl.device.absence import pocl_cache_problem
    from furcl.device.choice import list_candidates, platform_names
    from furcl.device.runtime_caches import POCL

    candidates = list_candidates()
    problem = pocl_cache_problem() if POCL in platform_names() else None
    if problem:
        yield Finding("error", "PoCL's cache folder", *problem)
        if not candidates:
            return
    if not candidates:
        found = "there is a platform, but it has no device (a GPU's may not be readable for you)"
        yield Finding("error", "OpenCL", found, f"{CPU_RUNTIME}; for a GPU join the group render")
        return
    passed = 0
    for candidate in candidates:
        verdict = candidate.verdict(fresh=True)
        what = f"device {candidate.index}"
        if verdict.passed:
            passed += 1
            yield Finding("ok", what, f"{candidate.description} passes the self-test")
        else:
            found = f"{candidate.description} is not usable: {verdict.reason}"
            yield Finding("warning", what, found, "another runtime; furcl passes this one over")
    if not passed:
        yield Finding("error", "OpenCL", "no device passes the self-test", CPU_RUNTIME)


def diagnose() -> Iterator[Finding]:
    """Look at everything that furcl needs, from Python to the self-test of every device."""
    yield from _check_python()
    yield from _check_files()
    yield from _check_embree()
    yield from _check_environment()
    yield from _check_runtimes()
    yield from _check_devices()
