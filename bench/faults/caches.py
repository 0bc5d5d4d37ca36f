"""Caches: files that are damaged, and crashes of a runtime that trusts its own."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from pathlib import Path

from faults.case import Case
from faults.harness import FURCL, SMALL, environment, furcl, run, told
from furcl.image.image import Image

FILES = 24
_CRASH = (
    "import os, signal, furcl.device.crashes as crashes\n"
    "crashes.watch()\n"
    "{renew}os.kill(os.getpid(), signal.{signal})"
)
_ABORT = (
    "import os, sys\n"
    "if 'furcl.device.selftest' in sys.orig_argv:\n"
    "    print('lib/CL/a.cc:577: Assertion `error == 0\\' failed.', flush=True)\n"
    "    os.abort()\n"
)


def _crash(env: dict[str, str], signal: str, runtime: str = "") -> None:
    """A process that ends by a signal, while it uses a runtime."""
    renew = f"crashes.renew({runtime!r})\n" if runtime else ""
    code = _CRASH.format(renew=renew, signal=signal)
    assert run((FURCL[0], "-P", "-c", code), env).code < 0


def _caches(folder: Path) -> dict[str, str]:
    for name in ("furcl", "pocl"):
        (folder / name).mkdir(exist_ok=True)
    return environment(
        FURCL_CACHE_DIR=str(folder / "furcl"), POCL_CACHE_DIR=str(folder / "pocl"),
        PYTHONFAULTHANDLER=None,
    )  # fmt: skip


def _render(folder: Path, env: dict[str, str]):
    return furcl(*SMALL, "-o", folder / "a.exr", env=env)


def _bits(folder: Path) -> bytes:
    return Image.load(folder / "a.exr").rgb.tobytes()


def _crash_is_told(folder: Path, quick: bool) -> str:
    """The next command names the folder, once; a kill leaves nothing to tell."""
    env = _caches(folder)

    def next_says() -> str:
        ended = furcl("info", "single_fibre", env=env)
        told(ended, 0)
        return ended.err

    said = ""
    for runtime, words in (
        ("", f"remove {folder}/pocl, or let POCL_CACHE_DIR"),
        ("Portable Computing Language", f"remove {folder}/pocl, or let POCL_CACHE_DIR"),
        ("NVIDIA CUDA", "or let CUDA_CACHE_PATH"),
        ("another", "runtime of OpenCL did"),
    ):
        _crash(env, "SIGSEGV", runtime)
        said = next_says()
        assert "crashed (Segmentation fault)" in said, said
        assert words in said, said
        assert "crashed" not in next_says(), "told twice"
    assert "remove" not in said, said
    _crash(env, "SIGKILL", "Portable Computing Language")
    assert "crashed" not in next_says(), "a kill is told as a crash"
    assert not list((folder / "furcl" / "crashes").iterdir()), "records are left"
    return said.splitlines()[0]


def _selftest_aborts(folder: Path, quick: bool) -> str:
    """A compiler that ends the self-test: whether its cache may be the cause is told at once."""
    (folder / "sitecustomize.py").write_text(_ABORT)
    env = _caches(folder)
    env["PYTHONPATH"] = f"{folder}{os.pathsep}{env['PYTHONPATH']}"
    words = ("SIGABRT", "Assertion", f"remove {folder}/pocl, or let POCL_CACHE_DIR name another")
    told(furcl("devices", env=env), 3, *words)
    return told(_render(folder, env), 3, *words)


def _pocl_cache(folder: Path, quick: bool) -> str:
    """One byte in the middle of FILES files of PoCL's cache, one file after the other."""
    if quick:
        return "at full size only"
    env = _caches(folder)
    told(_render(folder, env), 0)
    bits, kept = _bits(folder), folder / "kept"
    shutil.copytree(folder / "pocl", kept)
    files = sorted(p.relative_to(kept) for p in kept.rglob("*") if p.is_file() and p.stat().st_size)
    files = files[:: -(-len(files) // FILES)]
    ends: Counter[str] = Counter()
    for file in files:
        shutil.rmtree(folder / "pocl")
        shutil.copytree(kept, folder / "pocl")
        data = bytearray((kept / file).read_bytes())
        data[len(data) // 2] ^= 0xFF
        (folder / "pocl" / file).write_bytes(data)
        ended = _render(folder, env)
        said = ended.out + ended.err
        assert "Traceback" not in said, f"{file}: a traceback: {said.strip()[-200:]}"
        if ended.code < 0:
            ends["crash"] += 1
            if f"remove {folder}/pocl" not in said:  # PoCL may end a process that has said it
                said = furcl("info", "single_fibre", env=env).err
            assert f"remove {folder}/pocl" in said, f"{file}: the folder is not named"
        elif ended.code:
            ends["refused"] += 1
        else:
            ends["the same bits" if _bits(folder) == bits else "other bits"] += 1
    shutil.rmtree(folder / "pocl")
    told(_render(folder, env), 0)
    assert _bits(folder) == bits, "other bits after the folder was removed"
    return f"{len(files)} files: " + ", ".join(f"{n} {end}" for end, n in ends.most_common())


CASES = [
    Case("a crash of a runtime", _crash_is_told),
    Case("a crash of a runtime in the self-test", _selftest_aborts),
    Case("PoCL's own cache, damaged", _pocl_cache),
]
