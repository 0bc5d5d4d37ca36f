"""`furcl doctor` and the installation of a runtime: every fault is named with what mends it."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from furcl.cli import app
from furcl.device.choice import Candidate
from furcl.device.verdict import Verdict
from furcl.install import doctor, provision
from furcl.install.doctor import Finding
from furcl.install.provision import Step, StepImpossibleError

DEVICE = Candidate(0, "0:0", "cpu", "Runtime", "OpenCL 3.0", "1.0", "CPU", 2, 1 << 30)


def bad(findings: list[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.level != "ok"]


def fake_enumeration(monkeypatch: pytest.MonkeyPatch, code: int = 0, stderr: str = "") -> None:
    done = subprocess.CompletedProcess([], code, "", stderr)
    monkeypatch.setattr(doctor.subprocess, "run", lambda *_, **__: done)


def test_all_is_well_here() -> None:
    assert not [finding for finding in doctor.diagnose() if finding.level == "error"]


@pytest.mark.parametrize("name", ["OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"])
@pytest.mark.parametrize(
    ("folder", "level", "words"),
    [("missing", "error", "does not exist"), ("empty", "warning", "holds no .icd file")],
)
def test_loader_looks_elsewhere(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    folder: str,
    level: str,
    words: str,
) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv(name, str(tmp_path / folder))
    (finding,) = doctor._check_environment()
    assert finding.level == level
    assert words in finding.found
    assert finding.remedy == f"unset {name}"


def test_runtime_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    (tmp_path / "gone.icd").write_text("/no/such/libgone.so\n")
    (finding,) = [f for f in bad(list(doctor._check_runtimes())) if "gone.icd" in f.what]
    assert "/no/such/libgone.so" in finding.found
    assert finding.remedy == "python -m furcl.install.provision"


def test_intel_runtime_not_registered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provision, "intel_library", lambda: tmp_path / "libintelocl.so")
    monkeypatch.setattr(provision, "intel_registration", lambda: tmp_path / "none.icd")
    findings = [f for f in doctor._check_runtimes() if f.what == "intel-opencl-rt"]
    assert [f.remedy for f in findings] == ["python -m furcl.install.provision --add intel"]


@pytest.mark.parametrize(
    ("code", "stderr", "words", "remedy"),
    [
        (-11, "", "ends the process with signal 11", "remove the runtime"),
        (1, "LogicError: PLATFORM_NOT_FOUND_KHR", "no platform", "furcl.install.provision"),
        (0, "", "it has no device", "join the group render"),
    ],
)
def test_no_devices(
    monkeypatch: pytest.MonkeyPatch, code: int, stderr: str, words: str, remedy: str
) -> None:
    fake_enumeration(monkeypatch, code, stderr)
    monkeypatch.setattr("furcl.device.choice.list_candidates", list)
    (finding,) = doctor._check_devices()
    assert finding.level == "error"
    assert words in finding.found
    assert remedy in finding.remedy


def test_device_that_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_enumeration(monkeypatch)
    monkeypatch.setattr("furcl.device.choice.list_candidates", lambda: [DEVICE])
    monkeypatch.setattr(Candidate, "verdict", lambda self, fresh: Verdict(False, "bad sums"))
    passed_over, none_left = doctor._check_devices()
    assert "bad sums" in passed_over.found
    assert none_left.level == "error"
    assert "python -m furcl.install.provision" in none_left.remedy
    assert "as root: apt-get install pocl-opencl-icd" in none_left.remedy


@pytest.mark.parametrize("missing", ["package", "library"])
def test_embree_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    class Spec:
        origin = str(tmp_path / "embreex" / "__init__.py")

    spec = None if missing == "package" else Spec
    monkeypatch.setattr(doctor, "find_spec", lambda _: spec)
    (finding,) = doctor._check_embree()
    assert finding.level == "error"
    assert "pip install" in finding.remedy


def test_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(doctor, "kernel_folder", lambda: tmp_path)
    kernels, cache = doctor._check_files()
    assert (kernels.level, kernels.remedy) == ("error", "install furcl again")
    assert (cache.level, "FURCL_CACHE_DIR" in cache.remedy) == ("warning", True)


class Machine:
    """A machine on which only the runtime `works` helps, and installing `refused` is impossible."""

    def __init__(self, works: str, refused: str = "") -> None:
        self.works, self.refused = works, refused
        self.log: list[str] = []

    def usable(self) -> bool:
        return self.works in ("", *[entry.removeprefix("+") for entry in self.log])

    def step(self, name: str, removable: bool = True) -> Step:
        def install() -> None:
            if name == self.refused:
                raise StepImpossibleError("not here")
            self.log.append(f"+{name}")

        remove: Callable[[], None] | None = lambda: self.log.append(f"-{name}")  # noqa: E731
        return Step(name, name, install, remove if removable else None)


@pytest.mark.parametrize(
    ("machine", "result", "log"),
    [
        (Machine(""), True, []),
        (Machine("wheel"), True, ["+wheel"]),
        (Machine("debian"), True, ["+wheel", "-wheel", "+debian"]),
        (Machine("intel"), True, ["+wheel", "-wheel", "+debian", "+intel"]),
        (Machine("intel", "debian"), True, ["+wheel", "-wheel", "+intel"]),
        (Machine("none", "wheel"), False, ["+debian", "+intel", "-intel"]),
    ],
)
def test_order_of_installation(
    monkeypatch: pytest.MonkeyPatch, machine: Machine, result: bool, log: list[str]
) -> None:
    machine.log.clear()
    monkeypatch.setattr(provision, "devices_usable", machine.usable)
    steps = (machine.step("wheel"), machine.step("debian", removable=False), machine.step("intel"))
    assert provision.provision(steps) is result
    assert machine.log == log


class Commands:
    """Stands in for subprocess.run: keeps the commands, none of which finds a device."""

    def __init__(self) -> None:
        self.given: list[list[str]] = []

    def __call__(self, command: Sequence[str], **_: object) -> subprocess.CompletedProcess[str]:
        self.given.append(list(command))
        return subprocess.CompletedProcess(command, int("-c" in command), "", "")

    def of_the_system(self) -> list[list[str]]:
        return [c for c in self.given if "apt-get" in c or "sudo" in c]


@pytest.mark.parametrize("user", [0, 1000])
@pytest.mark.parametrize("add", [[], ["--add", "debian"]])
def test_packages_of_the_system_are_left_to_the_user(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], user: int, add: list[str]
) -> None:
    """Not even root's own process installs them unless it was asked to by --system."""
    commands = Commands()
    monkeypatch.setattr(provision.subprocess, "run", commands)
    monkeypatch.setattr(provision.shutil, "which", lambda name: f"/usr/bin/{name}")
    monkeypatch.setattr(provision.os, "geteuid", lambda: user)
    monkeypatch.setattr(provision, "STEPS", [s for s in provision.STEPS if s.name == "debian"])

    monkeypatch.setattr(sys, "argv", ["provision", *add])
    assert provision.main() == 3
    assert commands.of_the_system() == []
    assert "as root: apt-get install pocl-opencl-icd" in "".join(capfd.readouterr())

    monkeypatch.setattr(sys, "argv", ["provision", "--system", *add])
    assert provision.main() == 3
    installs = [c for c in commands.of_the_system() if "install" in c]
    assert installs
    assert all((c[0] == "sudo") == (user != 0) for c in installs)


@pytest.mark.parametrize("lock", ["pocl", "intel"])
def test_runtimes_are_pinned_by_their_hashes(lock: str) -> None:
    """Every line, as pip reads them, is one version and its hashes: nothing else is installed."""
    text = (provision.LOCKS / f"{lock}.lock").read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    assert lines
    pinned = re.compile(r"[\w.-]+==[\w.]+(\s+--hash=sha256:[0-9a-f]{64})+\s*")
    assert [line for line in lines if not pinned.fullmatch(line)] == []


@pytest.mark.parametrize(
    ("usable", "agrees", "installed", "result"),
    [
        ([True], True, 0, True),  # nothing to install: nobody is asked
        ([False], False, 0, False),
        ([False, False, True], True, 1, True),
    ],
)
def test_a_runtime_is_offered_before_it_is_installed(
    monkeypatch, capsys, usable, agrees, installed, result
):
    done, asked = [], []
    steps = [Step("pocl", "PoCL from PyPI", lambda: done.append("pocl"), None)]
    steps.append(Step("debian", "PoCL from Debian", lambda: done.append("apt"), None, "apt-get"))
    states = iter(usable)
    monkeypatch.setattr(provision, "devices_usable", lambda: next(states))
    monkeypatch.setattr(provision, "STEPS", steps)

    def ask(question):
        asked.append(question)
        return agrees

    assert provision.offer(ask) is result
    assert done == ["pocl"] * installed
    assert len(asked) == (usable[0] is False)
    if asked:
        assert "PoCL from PyPI" in asked[0]
        assert sys.prefix in asked[0]
        assert "Debian" not in asked[0]
        assert "apt-get install" in capsys.readouterr().out


def test_nobody_is_taken_for_a_no(monkeypatch):
    """Input that is no terminal installs nothing; --yes is named."""
    monkeypatch.setattr(provision, "devices_usable", lambda: False)
    monkeypatch.setattr(provision, "provision", lambda _: pytest.fail("installs"))
    said = CliRunner().invoke(app, ["doctor", "--install"])
    assert said.exit_code == 3
    assert "--yes" in said.output
    monkeypatch.setattr(provision, "provision", lambda _: True)
    assert CliRunner().invoke(app, ["doctor", "--install", "--yes"]).exit_code == 0


def test_without_a_network_the_message_says_what_to_do(monkeypatch):
    monkeypatch.setattr(sys, "base_prefix", "elsewhere")
    failed = subprocess.CompletedProcess([], 1)
    monkeypatch.setattr(provision.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(StepImpossibleError, match="PIP_NO_INDEX=1 PIP_FIND_LINKS=FOLDER"):
        provision._install_lock("intel")
