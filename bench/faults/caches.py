"""Caches: files that are damaged, and crashes of a runtime that trusts its own."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

from faults.case import Case
from faults.harness import FURCL, SMALL, environment, furcl, run, told
from furcl.image.image import Image

FILES = 24
_CRASH_CODE = (
    "import os, signal, furcl.device.crashes as crashes\n"
    "crashes.watch()\n"
    "os.kill(os.getpid(), signal.SIGSEGV)"
)
_CRASH = (FURCL[0], "-P", "-c", _CRASH_CODE)


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
    crashed = run(_CRASH, env)
    assert crashed.code < 0, f"ended with {crashed.code}"
    ended = furcl("info", "single_fibre", env=env)
    said = told(ended, 0, "crashed (Segmentation fault)", f"remove {folder}/pocl")
    assert "crashed" not in furcl("info", "single_fibre", env=env).err, "told twice"
    killed = run([part.replace("SIGSEGV", "SIGKILL") for part in _CRASH], env)
    assert killed.code < 0
    assert "crashed" not in furcl("info", "single_fibre", env=env).err, "a kill is told as a crash"
    assert not list((folder / "furcl" / "crashes").iterdir()), "records are left"
    return said


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
        if ended.code < 0:
            ends["crash"] += 1
            after = furcl("info", "single_fibre", env=env)
            assert f"remove {folder}/pocl" in after.err, f"{file}: the folder is not named"
        elif ended.code:
            ends["refused"] += 1
            assert "Traceback" not in said, f"{file}: a traceback: {said.strip()[-200:]}"
        else:
            ends["the same bits" if _bits(folder) == bits else "other bits"] += 1
    shutil.rmtree(folder / "pocl")
    told(_render(folder, env), 0)
    assert _bits(folder) == bits, "other bits after the folder was removed"
    return f"{len(files)} files: " + ", ".join(f"{n} {end}" for end, n in ends.most_common())


CASES = [
    Case("a crash of a runtime", _crash_is_told),
    Case("PoCL's own cache, damaged", _pocl_cache),
]
