"""Make sure of an OpenCL device that passes the self-test: `python -m furcl.install.provision`.

In this order, stopping at the first that works: what is there already, PoCL from PyPI, PoCL from
Debian or Ubuntu, Intel's CPU runtime from PyPI. `--add NAME` installs one of them in any case.

Packages of the system are installed with `--system` only, as `make` does; else the command that
would do it is named.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from furcl.errors import FurclError
from furcl.paths import python_command

LOCKS = Path(__file__).parent / "runtimes"
DOCTOR_COMMAND = "furcl doctor --install"
DEBIAN_PACKAGE = "pocl-opencl-icd"
DEBIAN_COMMAND = f"apt-get install {DEBIAN_PACKAGE}"
OFFLINE = (
    "where there is no network, download the wheels where there is one (README, Without a network) "
    "and name their folder: PIP_NO_INDEX=1 PIP_FIND_LINKS=FOLDER"
)


class StepImpossibleError(FurclError):
    """A runtime that cannot be installed here; the message says why."""


class PipFailedError(StepImpossibleError):
    """What pip could not do; it has said why."""


@dataclass(frozen=True)
class Step:
    """A way to get an OpenCL runtime.

    Attributes
    ----------
    name, title : str       for `--add`, and for people
    install : callable      raises StepImpossibleError
    remove : callable       undoes it; None: it is left alone
    by_hand : str           for a package of the system the command that installs it
    """

    name: str
    title: str
    install: Callable[[], None]
    remove: Callable[[], None] | None
    by_hand: str = ""


def _run(*command: str) -> None:
    print("  $", " ".join(command), flush=True)
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    code = subprocess.run(command, env=environment, stdin=subprocess.DEVNULL).returncode
    if code != 0:
        raise StepImpossibleError(f"{command[0]} ended with code {code}")


def _pip(*arguments: str) -> None:
    if sys.prefix == sys.base_prefix:
        raise StepImpossibleError("wheels are installed into a virtual environment only")
    try:
        _run(*python_command("-m", "pip", *arguments))
    except StepImpossibleError as error:
        raise PipFailedError(f"pip: {error}") from None


def _install_lock(name: str) -> None:
    try:
        _pip("install", "--quiet", "--require-hashes", "--requirement", str(LOCKS / f"{name}.lock"))
    except PipFailedError as error:
        raise StepImpossibleError(f"{error}; {OFFLINE}") from None


def _remove_lock(name: str) -> None:
    lines = (LOCKS / f"{name}.lock").read_text(encoding="utf-8").splitlines()
    packages = [line.split("==")[0] for line in lines if "==" in line]
    _pip("uninstall", "--quiet", "--yes", *packages)


def loader_folder() -> Path | None:
    """The folder beside pyopencl whose .icd files its own loader reads, besides the system's.

    None where pyopencl is not from a wheel and uses the system's loader.
    """
    spec = find_spec("pyopencl")
    folder = Path(spec.origin).parent / ".libs" if spec and spec.origin else None
    return folder if folder and folder.is_dir() else None


def intel_library() -> Path | None:
    """Intel's OpenCL library, if its wheel is installed."""
    try:
        files = metadata.files("intel-opencl-rt") or []
    except metadata.PackageNotFoundError:
        return None
    for file in files:
        if file.name == "libintelocl.so":
            return Path(str(file.locate())).resolve()
    return None


def intel_registration() -> Path | None:
    """The .icd file that furcl writes for Intel's library (the wheel's own names a wrong path)."""
    folder = loader_folder()
    return folder / "furcl-intel.icd" if folder else None


def _install_intel() -> None:
    registration = intel_registration()
    if registration is None:
        raise StepImpossibleError("pyopencl is not from a wheel; its loader cannot be extended")
    _install_lock("intel")
    library = intel_library()
    if library is None:
        raise StepImpossibleError("the wheel intel-opencl-rt holds no libintelocl.so")
    registration.write_text(f"{library}\n", encoding="utf-8")


def _remove_intel() -> None:
    registration = intel_registration()
    if registration:
        registration.unlink(missing_ok=True)
    _remove_lock("intel")


def _as_root(*command: str) -> tuple[str, ...]:
    if not shutil.which("apt-get"):
        raise StepImpossibleError("there is no apt-get")
    if os.geteuid() == 0:
        return command
    if (
        not shutil.which("sudo")
        or subprocess.run(["sudo", "--non-interactive", "true"], capture_output=True).returncode
    ):
        raise StepImpossibleError(
            f"it needs root or sudo without a password; as root: {DEBIAN_COMMAND}"
        )
    return ("sudo", "--non-interactive", *command)


def _install_debian() -> None:
    _run(*_as_root("apt-get", "update", "--quiet=2"))
    _run(*_as_root("apt-get", "install", "--quiet=2", "--yes", DEBIAN_PACKAGE))


STEPS = (
    Step("pocl", "PoCL from PyPI", lambda: _install_lock("pocl"), lambda: _remove_lock("pocl")),
    # A system package that does not help is left alone: other programs may want it.
    Step("debian", "PoCL from the distribution", _install_debian, None, DEBIAN_COMMAND),
    Step("intel", "Intel's CPU runtime from PyPI (0.9 GB)", _install_intel, _remove_intel),
)


def devices_usable() -> bool:
    """Print the devices, in a new process that sees new ones; True if one passes the self-test."""
    environment = {k: v for k, v in os.environ.items() if k != "FURCL_DEVICE"}
    command = python_command("-c", "from furcl.cli import main; main(['devices'])")
    return subprocess.run(command, env=environment).returncode == 0


def _install(step: Step, system: bool) -> None:
    if step.by_hand and not system:
        raise StepImpossibleError(f"it is left to you; as root: {step.by_hand}")
    step.install()


def provision(steps: Sequence[Step], *, system: bool = False) -> bool:
    """Try each step until a device passes the self-test; True if one does.

    `system` says whether packages of the system may be installed.
    """
    print("OpenCL devices of this machine:", flush=True)
    if devices_usable():
        return True
    for step in steps:
        print(f"Trying {step.title}:", flush=True)
        try:
            _install(step, system)
        except StepImpossibleError as error:
            print(f"  not possible: {error}", flush=True)
            continue
        if devices_usable():
            return True
        print("  it does not work here", flush=True)
        if step.remove:
            step.remove()
    return False


def offer(ask: Callable[[str], bool]) -> bool:
    """Install a runtime where no device is usable and `ask` says yes; True if one is usable then.

    Nothing outside of this environment is changed: packages of the system are named.
    """
    if devices_usable():
        print("A device passes the self-test: nothing needs to be installed.")
        return True
    titles = ", then ".join(step.title for step in STEPS if not step.by_hand)
    print(f"No OpenCL device passes the self-test. As root this may be all: {DEBIAN_COMMAND}")
    if not ask(f"Install into {sys.prefix}, until a device passes: {titles}?"):
        print(f"Nothing was installed. Later: {DOCTOR_COMMAND}")
        return False
    return provision(STEPS)


def main() -> int:
    """Entry point; 0 if a device is usable at the end, else 3."""
    parser = argparse.ArgumentParser(prog="python -m furcl.install.provision", description=__doc__)
    parser.add_argument("--add", choices=[step.name for step in STEPS], help="install this one")
    parser.add_argument(
        "--system", action="store_true", help="packages of the system too, as root or by sudo"
    )
    given = parser.parse_args()
    for step in STEPS:
        if step.name == given.add:
            try:
                _install(step, given.system)
            except StepImpossibleError as error:
                print(f"{step.title}: not possible: {error}", file=sys.stderr)
                return 3
    if provision(STEPS, system=given.system):
        return 0
    print(
        "No OpenCL device passes the self-test and none could be installed. `furcl doctor` tells "
        f"what is wrong with each; install a driver for your GPU or a CPU runtime (as root: "
        f"{DEBIAN_COMMAND}), and run `python -m furcl.install.provision` again.",
        file=sys.stderr,
    )
    return 3


if __name__ == "__main__":
    sys.exit(main())
