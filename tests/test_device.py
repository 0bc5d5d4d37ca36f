"""Choice of the device, self-test and its memory."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import furcl
from furcl.device import choice as device_module
from furcl.device import program, random_numbers, selftest, verdict
from furcl.device.choice import Candidate, Device, choose, match, open_device
from furcl.device.verdict import Verdict
from furcl.errors import DeviceError, FurclError, KernelBuildError, NoDeviceError


def candidate(index: int, kind: str, name: str, driver: str) -> Candidate:
    return Candidate(index, f"{index}:0", name, "Runtime", "OpenCL 3.0", driver, kind, 2, 1 << 30)


OLD = candidate(0, "CPU", "old", "3.0-rc2")
NEW = candidate(1, "CPU", "new", "2026.22.10")
BROKEN = candidate(2, "CPU", "broken", "9999.1")
GPU = candidate(3, "GPU", "gpu", "1.0")
OTHER = candidate(4, "other", "dsp", "99999")


@pytest.fixture
def fake_verdicts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every made-up device passes, but BROKEN."""
    monkeypatch.setattr(Candidate, "verdict", lambda self: Verdict(self != BROKEN, "it is broken"))


@pytest.mark.parametrize(
    ("there", "spec", "expected"),
    [
        ([OLD, NEW, BROKEN, GPU, OTHER], "", GPU),
        ([OLD, NEW, BROKEN], "", NEW),
        ([OTHER, OLD], "", OLD),
        ([OLD, NEW, GPU], "0", OLD),
        ([OLD, NEW, GPU], "1:0", NEW),
        ([OLD, NEW, GPU], "OLD", OLD),
        ([OLD, NEW, GPU], "runtime", GPU),
        ([OLD, BROKEN], "runtime", OLD),
    ],
)
@pytest.mark.usefixtures("fake_verdicts")
def test_choice(there: list[Candidate], spec: str, expected: Candidate) -> None:
    assert choose(there, spec, "--device") == expected


@pytest.mark.parametrize(
    ("there", "spec", "error", "words"),
    [
        ([], "", NoDeviceError, "furcl.install.provision"),
        ([BROKEN], "", NoDeviceError, "it is broken"),
        ([OLD, BROKEN], "broken", DeviceError, "it is broken"),
        ([OLD, NEW], "nvidia", DeviceError, "'nvidia' names no OpenCL device; there are 0: old"),
        ([OLD, NEW], "7", DeviceError, "--device '7'"),
    ],
)
@pytest.mark.usefixtures("fake_verdicts")
def test_choice_fails(
    there: list[Candidate], spec: str, error: type[FurclError], words: str
) -> None:
    with pytest.raises(error) as caught:
        choose(there, spec, "--device")
    assert words in str(caught.value)
    assert type(caught.value) is error


def test_driver_versions_compare_as_numbers() -> None:
    ten, nine = candidate(0, "CPU", "a", "3.10"), candidate(1, "CPU", "b", "3.9")
    assert ten.rank() < nine.rank()
    assert match([ten, nine], "3.9") == [nine]


def test_environment_variable_chooses(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FURCL_DEVICE", device.driver_version)
    opened = open_device()
    assert (opened.name, opened.driver_version) == (device.name, device.driver_version)
    monkeypatch.setenv("FURCL_DEVICE", "no such device")
    with pytest.raises(DeviceError, match="FURCL_DEVICE 'no such device'"):
        open_device()
    assert open_device(device.driver_version).driver_version == device.driver_version


def test_no_device_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_module, "list_candidates", list)
    monkeypatch.delenv("FURCL_DEVICE", raising=False)
    with pytest.raises(NoDeviceError, match="furcl doctor"):
        open_device()


def test_selftest_passes(device: Device) -> None:
    selftest.run(device)


@pytest.mark.parametrize(
    ("text", "mutant", "error", "words"),
    [
        (".s76543210", "", DeviceError, "float8"),
        ("copysign(u, -1.0f)", "u", DeviceError, "float functions"),
        ("clz((uint)i)", "0", DeviceError, "integer functions"),
        ("if (flags[i]) place", "place", DeviceError, "atomic"),
        ("shared[1] + place", "shared[1]", DeviceError, "local memory"),
        ("2u * i, 3u", "2u * i, 4u", DeviceError, "Philox"),
        ("hash ^= key.y", "hash += key.y", DeviceError, "Sobol"),
        ("float real; uint whole", "double real; uint whole", FurclError, "lays a struct out"),
        ("barrier(", "no_such_function(", KernelBuildError, "does not compile"),
    ],
)
def test_selftest_sees_faults(
    device: Device,
    monkeypatch: pytest.MonkeyPatch,
    text: str,
    mutant: str,
    error: type[FurclError],
    words: str,
) -> None:
    original = program.kernel_text

    def mutated(*arguments: object) -> str:
        source = original(*arguments)  # pyright: ignore[reportArgumentType]
        assert text in source
        return source.replace(text, mutant)

    monkeypatch.setattr(program, "kernel_text", mutated)
    with pytest.raises(error, match=words):
        selftest.run(device)


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ("00000000 00000000 00000000 00000000", "00000000 00000000",
         "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff",
         "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0",
         "d16cfe09 94fdcceb 5001e420 24126ea1"),
    ],
)  # fmt: skip
def test_philox_known_answers(counter: str, key: str, expected: str) -> None:
    """The known answers that Random123 publishes for philox4x32 with ten rounds."""
    words = [[int(word, 16) for word in text.split()] for text in (counter, key, expected)]
    found = random_numbers.philox4x32(np.array([words[0]]), (words[1][0], words[1][1]))
    assert found[0].tolist() == words[2]


@pytest.mark.parametrize(
    ("output", "code", "words"),
    [
        ("error: unknown target CPU 'generic'\n", 10, "older than this CPU"),
        ('error: Executable "ld" doesn\'t exist!\nfailed.\n', -6, "package binutils"),
        ("LLVM ERROR: no pass\n", -6, "SIGABRT: LLVM ERROR: no pass"),
        ("", -11, "SIGSEGV: it printed nothing"),
        ("build failed\nx.clh:1: error: no type\n", 10, "x.clh:1: error: no type"),
        ("float8 arithmetic: differs\nmore\n", 10, "float8 arithmetic: differs"),
        ("Traceback (most recent call last):\n  File x\nOSError: no\n", 1, "OSError: no"),
    ],
)
def test_failures_in_plain_words(output: str, code: int, words: str) -> None:
    assert words in verdict.explain(output, code)


def fake_python(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> Path:
    """Stand in for the interpreter that runs self-tests; counts its runs in a file."""
    path, runs = folder / "python", folder / "runs"
    path.write_text(f"#!/bin/sh\necho run >> {runs}\n{script}\n")
    path.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(path))
    monkeypatch.setenv("FURCL_CACHE_DIR", str(folder / "cache"))
    return runs


@pytest.mark.parametrize(
    ("script", "passed", "words", "remembered"),
    [
        ("exit 0", True, "", True),
        ("echo wrong sums; exit 10", False, "wrong sums", False),
        ("echo bad CPU; kill -ABRT $$", False, "SIGABRT: bad CPU", False),
        ("echo cannot start; exit 1", False, "cannot start", False),
        ("exec sleep 20", False, "did not end", False),
    ],
)
def test_verdict_survives_any_end(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    script: str,
    passed: bool,
    words: str,
    remembered: bool,
) -> None:
    runs = fake_python(tmp_path, monkeypatch, script)
    monkeypatch.setattr(verdict, "TIMEOUT_S", 1.0)
    first, second = verdict.of("0:0", "some device"), verdict.of("0:0", "some device")
    assert first.passed is second.passed is passed
    assert words in first.reason
    assert runs.read_text().count("run") == (1 if remembered else 2)


MAY_BE_THE_CACHE = {
    "a crash": ("echo 'pocl.cc:577: Assertion `error == 0 failed'; kill -ABRT $$", True),
    "a silent crash": ("kill -SEGV $$", True),
    "no compiler's error": ("echo 'a.cl does not compile on X. It says:'; exit 10", True),
    "a file of the cache": (
        "echo 'a.cl does not compile'; echo 'error: <invalid loc>: no such file'; exit 10",
        True,
    ),
    "a kernel's error": (
        "echo 'a.cl does not compile'; echo 'a.cl:2:7: error: no'; exit 10",
        False,
    ),
    "other sums": ("echo 'float8: other than numpy'; exit 10", False),
    "an old compiler": ("echo 'unknown target CPU'; kill -ABRT $$", False),
}


@pytest.mark.parametrize(
    ("runtime", "variable"),
    [
        ("Portable Computing Language", "POCL_CACHE_DIR"),
        ("NVIDIA CUDA", "CUDA_CACHE_PATH"),
        ("another", ""),
    ],
)
def test_caches_of_runtimes_are_named_where_they_may_be_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runtime: str, variable: str
) -> None:
    candidate = Candidate(0, "0:0", "a device", runtime, "1", "2", "CPU", 1, 2**30)
    monkeypatch.setenv(variable or "NONE", str(tmp_path / "built"))
    for name, (script, expected) in MAY_BE_THE_CACHE.items():
        fake_python(tmp_path, monkeypatch, script)
        reason = candidate.verdict().reason
        advice = f"remove {tmp_path / 'built'}, or let {variable} name another folder"
        assert (advice in reason) == (expected and bool(variable)), f"{name}: {reason}"
        assert len(reason) < 600


def test_verdict_is_asked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a change of the driver or of the self-test, on request, or without a cache."""
    runs = fake_python(tmp_path, monkeypatch, "exit 0")

    def count() -> int:
        return runs.read_text().count("run")

    verdict.of("0:0", "driver 1")
    verdict.of("0:0", "driver 2")
    assert count() == 2
    verdict.of("0:0", "driver 2", fresh=True)
    assert count() == 3
    monkeypatch.setattr(verdict, "_text_hash", lambda: "other text")
    verdict.of("0:0", "driver 2")
    assert count() == 4
    for path in (tmp_path / "cache" / "selftest").iterdir():
        path.write_text("{half a fi")
    verdict.of("0:0", "driver 2")
    assert count() == 5
    monkeypatch.setenv("FURCL_CACHE_DIR", os.devnull)
    verdict.of("0:0", "driver 2")
    assert count() == 6


def test_a_verdict_holds_where_it_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a runtime needs of the environment is part of it: a linker, folders, settings."""
    runs = fake_python(tmp_path, monkeypatch, "exit 0")
    for name, value in (("PATH", "/nowhere"), ("HOME", "/nowhere"), ("POCL_DEVICES", "none")):
        verdict.of("0:0", "a device")
        before = runs.read_text().count("run")
        monkeypatch.setenv(name, value)
        verdict.of("0:0", "a device")
        assert runs.read_text().count("run") == before + 1
        monkeypatch.undo()
        runs = fake_python(tmp_path, monkeypatch, "exit 0")


def test_what_another_device_passed_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A whole file under the name of another."""
    runs = fake_python(tmp_path, monkeypatch, "exit 0")
    verdict.of("0:0", "a device")
    folder = tmp_path / "cache" / "selftest"
    (path,) = folder.iterdir()
    verdict.of("0:0", "another")
    (other,) = (file for file in folder.iterdir() if file != path)
    path.rename(other)
    verdict.of("0:0", "another")
    assert runs.read_text().count("run") == 3


@pytest.mark.parametrize("start", ["furcl", "-m"])
def test_modules_of_the_working_folder_are_not_run(start: str, tmp_path: Path) -> None:
    """A scene's folder may hold a numpy.py; the self-test runs in a process of its own."""
    for name in ("numpy", "pyopencl", "json"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()\nraise SystemExit(5)\n")
    script, module = Path(sys.executable).with_name("furcl"), [sys.executable, "-m", "furcl"]
    command = [str(script)] if start == "furcl" else module
    environment = {
        **os.environ,
        "FURCL_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": str(Path(furcl.__file__).parents[1]),
    }
    done = subprocess.run([*command, "devices"], cwd=tmp_path, env=environment, capture_output=True)
    assert done.returncode == 0
    assert list((tmp_path / "cache" / "selftest").iterdir())
    assert not (tmp_path / "ran").exists()
