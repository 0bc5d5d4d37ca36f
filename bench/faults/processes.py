"""Processes: environments, caches, disks, signals, forks, and several at once."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from faults.case import Case, NotHereError
from faults.harness import FURCL, SMALL, environment, furcl, run, start, told
from furcl.image.image import Image

_PR_CAPBSET_DROP, _CAP_DAC_OVERRIDE = 24, 1


def _obey_rights() -> None:
    """In a child that root starts: what the rights of files forbid is forbidden."""
    ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, _CAP_DAC_OVERRIDE, 0, 0, 0)


def _heed_signals() -> None:
    """In a child: a shell starts what is in its background with Ctrl-C ignored."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def _read_only(folder: Path, name: str) -> str:
    path = folder / name
    path.mkdir()
    path.chmod(0o555)
    return str(path)


def _own_caches(folder: Path, **changes: str | None) -> dict[str, str]:
    """An environment with caches of furcl and PoCL in a folder, empty."""
    for name in ("furcl", "pocl"):
        (folder / name).mkdir(exist_ok=True)
    return environment(
        **{"FURCL_CACHE_DIR": str(folder / "furcl"), "POCL_CACHE_DIR": str(folder / "pocl")}
        | changes
    )


def _render(folder: Path, *more: object, env: dict[str, str] | None = None, **options):
    return furcl(*SMALL, "-o", folder / "a.exr", *more, env=env, **options)


def _bits(folder: Path) -> bytes:
    return Image.load(folder / "a.exr").rgb.tobytes()


def _require_pocl() -> None:
    """Of PoCL's needs other runtimes have none: a linker, and a cache of its own."""
    said = furcl("devices").out
    if "Portable Computing Language" not in _used(said):
        raise NotHereError("the device that furcl uses here is none of PoCL's")


def _used(said: str) -> str:
    """Of what `furcl devices` prints, the line of the device that is used."""
    number = said.rpartition("furcl uses device ")[2].partition(":")[0]
    return next((line for line in said.splitlines() if line.startswith(f"{number}:")), "")


def _pocl_read_only(folder: Path, quick: bool) -> str:
    _require_pocl()
    env = environment(
        POCL_CACHE_DIR=_read_only(folder, "ro"), FURCL_CACHE_DIR=str(folder / "furcl")
    )
    said = told(_render(folder, env=env, preexec_fn=_obey_rights), 3, "POCL_CACHE_DIR", "ro")
    assert "no runtime is installed" not in said
    return said


def _home_read_only(folder: Path, quick: bool) -> str:
    """PoCL needs its cache, others render without one."""
    env = environment(
        HOME=_read_only(folder, "ro"),
        XDG_CACHE_HOME=None,
        POCL_CACHE_DIR=None,
        FURCL_CACHE_DIR=str(folder / "furcl"),
    )
    ended = _render(folder, env=env, preexec_fn=_obey_rights)
    try:
        _require_pocl()
    except NotHereError:
        return told(ended, 0)
    return told(ended, 3, "POCL_CACHE_DIR", "ro")


def _furcl_read_only(folder: Path, quick: bool) -> str:
    env = environment(FURCL_CACHE_DIR=_read_only(folder, "ro"))
    return told(_render(folder, env=env, preexec_fn=_obey_rights), 0, "set FURCL_CACHE_DIR")


def _convergence_read_only(folder: Path, quick: bool) -> str:
    env = environment(FURCL_CACHE_DIR=_read_only(folder, "ro"))
    command = ("bench", "convergence", "single_fibre", "--quick", "--size", "8x8", "--spp", "2,4")
    return told(
        furcl(*command, "--runs", "2", "-o", folder / "o", env=env, preexec_fn=_obey_rights),
        0,
        "set FURCL_CACHE_DIR",
    )


def _without_linker(folder: Path, quick: bool) -> str:
    """A failure that is over is over: without `ld`, and then with it."""
    _require_pocl()
    env = _own_caches(folder, PATH="/nonexistent")
    said = told(_render(folder, env=env), 3, "linker ld", "PATH")
    if not quick:
        told(_render(folder, env=_own_caches(folder)), 0)
        said = told(_render(folder, env=env), 3, "linker ld")
    return said


def _empty_environment(folder: Path, quick: bool) -> str:
    _require_pocl()
    path = os.pathsep.join(p for p in sys.path if p)
    env = {"PYTHONPATH": path, **{k: v for k, v in _own_caches(folder).items() if "CACHE" in k}}
    return told(_render(folder, env=env), 3, "linker ld")


def _failure_forgotten(folder: Path, quick: bool) -> str:
    """A cache folder of PoCL that could not be used, and then can."""
    _require_pocl()
    env = _own_caches(folder, POCL_CACHE_DIR="/proc/nowhere")
    told(_render(folder, env=env), 3, "POCL_CACHE_DIR")
    good = environment(FURCL_CACHE_DIR=str(folder / "furcl"))
    return told(furcl("devices", env=good), 0, "passes the self-test")


def _full_disk(folder: Path, quick: bool) -> str:
    with Path("/dev/full").open("w") as full:
        ended = furcl("info", "single_fibre", stdout=full)
    return told(ended, 2, "No space left")


def _ascii(folder: Path, quick: bool) -> str:
    """The C locale without UTF-8 mode: page, CSV, statistics and terminal."""
    env = environment(LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0", LANG=None)
    python = [sys.executable, "-X", "utf8=0", *FURCL[1:]]
    told(run([*python, *SMALL, "-o", str(folder / "é.exr"), "--stats", str(folder / "s")], env), 0)
    if quick:
        return "picture and statistics"
    out = str(folder / "o")
    command = ["bench", "convergence", "single_fibre", "--quick", "--size", "8x8", "--spp", "2,4"]
    told(run([*python, *command, "--runs", "2", "-o", out], env), 0)
    told(run([*python, "bench", "report", out], env), 0)
    return "picture, statistics, CSV and page"


def _little_memory(n_kib: int, folder: Path, quick: bool) -> str:
    def limit() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (n_kib * 1024, n_kib * 1024))

    ended = _render(folder, preexec_fn=limit)
    said = ended.out + ended.err
    assert "Traceback" not in said, said[-300:]
    assert ended.code in (0, 2, 3), f"code {ended.code}: {said[-300:]}"
    assert ended.code == 0 or "ulimit -v" in said, said[-300:]
    return f"code {ended.code}: {said.strip().splitlines()[-1][:160]}"


def _signalled(number: int, times: int, after: str, folder: Path, quick: bool) -> str:
    """Signals to the whole group, as a terminal sends them, once a word was written."""
    out, fresh = folder / "a.exr", _own_caches(folder)
    env = fresh if after == "device" else environment()
    command = [*FURCL, "-v", "render", "single_fibre", "--size", "128x128", "--spp", "1000000"]
    child = start([*command, "-o", str(out)], env, start_new_session=True, preexec_fn=_heed_signals)
    said = []
    assert child.stderr
    for line in child.stderr:
        said.append(line)
        if after in line:
            break
    time.sleep(0.5)
    for _ in range(times):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, number)
        time.sleep(0.2)
    rest = child.communicate(timeout=300)[1]
    text = "".join(said) + rest
    assert "Traceback" not in text, text[-300:]
    assert "terminate called" not in text, text[-300:]
    expected = {128 + number, -number} if times > 1 else {128 + number}
    assert child.returncode in expected, f"code {child.returncode}: {text[-300:]}"
    if times > 1:
        return f"ended with {child.returncode}"
    out = out if out.exists() else out.with_name("a.partial.exr")
    if not out.exists():
        assert after == "device", f"nothing written: {text[-300:]}"
        return f"code {child.returncode}, nothing written, {rest.strip().splitlines()[-1][:90]}"
    image = Image.load(out)
    assert np.isfinite(image.rgb).all(), "pixels that are not finite"
    return f"code {child.returncode}, {image.stats['spp']} whole samples a pixel are written"


def _no_samples(folder: Path, quick: bool) -> str:
    """Stopped within the first sample: the rest is black, with alpha and count 0."""
    ended = furcl("render", "single_fibre", "--size", "64x64", "--wave-size", "1000",
                  "--time-limit", "1e-9", "-o", folder / "a.exr")  # fmt: skip
    said = told(ended, 0, "pixels have no samples")
    assert not (folder / "a.exr").exists(), "it takes the name of a whole picture"
    image = Image.load(folder / "a.partial.exr")
    assert image.samples is not None
    empty = image.samples == 0
    assert empty.any(), "all pixels have samples"
    assert np.isfinite(image.rgb).all(), "pixels that are not finite"
    assert (image.rgb[empty] == 0.0).all()
    assert f"{int(empty.sum())} pixels" in ended.err
    return said


def _killed_saving(folder: Path, quick: bool) -> str:
    """Temporary files of killed processes: old ones are removed, young and foreign ones kept."""
    old, young = folder / f".furcl-{'0' * 16}.exr", folder / f".furcl-{'1' * 16}.png"
    foreign = folder / ".furcl-notes.txt"
    for path in (old, young, foreign):
        path.touch()
    for path in (old, foreign):
        os.utime(path, (time.time() - 1e5, time.time() - 1e5))
    told(_render(folder), 0)
    left = sorted(path.name for path in folder.iterdir())
    expected = sorted([young.name, foreign.name, "a.exr", "a.png"])
    assert left == expected, f"left: {left}"
    return "old ones are removed, young and foreign ones kept"


def _unwritable(name: str, folder: Path, quick: bool) -> str:
    """Told before the render: nothing is compiled."""
    (folder / "file").touch()
    target = f"{folder}/{name}".encode("utf-8", "surrogateescape")
    command = [*(part.encode() for part in (*FURCL, *SMALL, "-o")), target]
    ended = run(command)
    assert "compiled in" not in ended.err, "told after the render"
    return told(ended, 2)


def _fork(folder: Path, quick: bool) -> str:
    """A child that is forked after a render says so; one forked before it renders."""
    script = (
        "import os, sys, furcl\n"
        "from furcl.rendering.renderer import Renderer\n"
        "scene = furcl.load_scene('single_fibre', size='8x8', spp=1)\n"
        "pid = os.fork()\n"
        "if pid == 0:\n"
        "    furcl.render(scene); os._exit(0)\n"
        "print('before:', os.waitpid(pid, 0)[1])\n"
        "kept = Renderer(scene); kept.advance(1)\n"
        "def render(): furcl.render(scene)\n"
        "def go_on(): kept.advance(1); kept.image()\n"
        "for call in (render, go_on):\n"
        "    pid = os.fork()\n"
        "    if pid == 0:\n"
        "        try: call()\n"
        "        except furcl.FurclError as error: print(error, flush=True); os._exit(7)\n"
        "        os._exit(0)\n"
        "    print('after:', os.waitpid(pid, 0)[1] >> 8, flush=True)\n"
    )
    child = start([sys.executable, "-P", "-c", script])
    try:
        out, err = child.communicate(timeout=120)
    except subprocess.TimeoutExpired:
        child.kill()
        raise AssertionError("hangs") from None
    assert "before: 0" in out, out + err[-300:]
    assert out.count("after: 7") == 2, out + err[-300:]
    return "said in the child"


def _damaged_caches(folder: Path, quick: bool) -> str:
    """Every file of both caches damaged, one kind of damage after the other: the same bits."""
    env = _own_caches(folder)
    told(_render(folder, env=env), 0)
    bits = _bits(folder)
    damages: dict[str, Callable[[bytes], bytes]] = {
        "emptied": lambda data: b"",
        "cut off": lambda data: data[: len(data) // 2],
        "turned": lambda data: data[:20] + bytes(b ^ 0xFF for b in data[20:60]) + data[60:],
    }
    for name, damage in list(damages.items())[: 1 if quick else 3]:
        n = 0
        for path in (folder / "furcl").rglob("*"):
            if path.is_file():
                path.write_bytes(damage(path.read_bytes()))
                n += 1
        assert n, "no file in the cache"
        told(_render(folder, env=env), 0)
        assert _bits(folder) == bits, f"{name}: other bits"
    shutil.rmtree(folder / "pocl")
    (folder / "pocl").mkdir()
    shutil.rmtree(folder / "furcl")
    told(_render(folder, env=env), 0)
    assert _bits(folder) == bits
    return "the same bits"


def _two_at_once(folder: Path, quick: bool) -> str:
    """Processes that start with empty caches at once."""
    env = _own_caches(folder)
    children = []
    for n in range(2 if quick else 4):
        (folder / str(n)).mkdir()
        command = [*FURCL, *SMALL, "-o", str(folder / str(n) / "a.exr")]
        children.append(start(command, env, stdout=subprocess.DEVNULL))
    for child in children:
        err = child.communicate()[1]
        assert child.returncode == 0, err[-300:]
    bits = {_bits(folder / str(n)) for n in range(len(children))}
    assert len(bits) == 1, "other bits"
    return f"{len(children)} processes, the same bits"


_C, _T, _H = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
_QUICK = [
    Case("read-only PoCL cache", _pocl_read_only),
    Case("read-only home", _home_read_only),
    Case("a failed start without `ld`, then with it", _without_linker),
    Case("an unusable POCL_CACHE_DIR, then a good one", _failure_forgotten),
    Case("full disk on standard output", _full_disk),
    Case("C locale without UTF-8 mode", _ascii),
    Case("ulimit -v 300 MB", partial(_little_memory, 300_000)),
    Case("Ctrl-C while rendering", partial(_signalled, _C, 1, "first samples")),
    Case("SIGTERM while rendering", partial(_signalled, _T, 1, "first samples")),
    Case("stopped within the first sample", _no_samples),
    Case("temporary files of killed processes", _killed_saving),
    Case("output below a file", partial(_unwritable, "file/a.exr")),
    Case("output of 300 letters", partial(_unwritable, "a" * 300 + ".exr")),
    Case("fork after a render", _fork),
]
_SLOW = [
    Case("read-only furcl cache", _furcl_read_only),
    Case("read-only furcl cache, convergence", _convergence_read_only),
    Case("empty environment", _empty_environment),
    Case("ulimit -v 600 MB", partial(_little_memory, 600_000)),
    Case("ulimit -v 900 MB", partial(_little_memory, 900_000)),
    Case("Ctrl-C while kernels compile", partial(_signalled, _C, 1, "device")),
    Case("three Ctrl-C while kernels compile", partial(_signalled, _C, 3, "device")),
    Case("three Ctrl-C while rendering", partial(_signalled, _C, 3, "first samples")),
    Case("SIGHUP while rendering", partial(_signalled, _H, 1, "first samples")),
    Case("damaged caches", _damaged_caches),
    Case("four starts at once, empty caches", _two_at_once),
]


def _at_full_size(case: Case) -> Case:
    """A case of minutes: its quick form leaves it to the full run."""
    return Case(
        case.name,
        lambda folder, quick: "at full size only" if quick else case.run(folder, quick),
    )


CASES = [*_QUICK, *(_at_full_size(case) for case in _SLOW)]
