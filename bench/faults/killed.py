"""Processes that are killed at every moment, and caches that go away under them: the same bits."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import shutil
import signal
import subprocess
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from faults.case import Case
from faults.harness import FURCL, SMALL, environment, furcl, start, told
from furcl.image.image import Image

N_KILLS = 57
N_KILLS_OF_CONVERGENCE = 43

#: Of each: what a render has to remember beside the film.
RENDERS: Mapping[str, tuple[str, ...]] = {
    "even": (),
    "adaptive": ("--set", "render.allocation=adaptive"),
    "learning": ("--set", "render.roulette=adjoint"),
}


def _killed(command: list[str], seconds: float, env: Mapping[str, str]) -> bool:
    """Start a command, and kill it and all that it started after so long; whether it was there."""
    child = start(command, env, start_new_session=True)
    try:
        _, err = child.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.communicate()
        return True
    assert child.returncode == 0, err[-300:]
    return False


def _renders(folder: Path, quick: bool) -> str:
    """Renders that are killed again and again, and go on from their checkpoint where there is one.

    Every kill leaves whole files or none.
    """
    rng, kills, gone_on, wanted = np.random.default_rng(1), 0, 0, 2 if quick else N_KILLS
    names = list(RENDERS)[: 1 if quick else None]
    wholes: dict[str, bytes] = {}
    rounds, longest = 0, 0.0
    while kills < wanted:
        name = names[rounds % len(names)]
        rounds += 1
        own = folder / str(rounds)
        own.mkdir()
        spp = "200" if quick else "400"
        base = [*FURCL, "-v", "render", "single_fibre", "--size", "64x64", "--spp", spp]
        base += [*RENDERS[name], "-o"]
        if name not in wholes:
            began = time.monotonic()
            assert not _killed([*base, str(folder / f"{name}.exr")], 600.0, environment())
            longest = time.monotonic() - began
            wholes[name] = _bits(folder / f"{name}.exr")
        command = [*base, str(own / "a.exr"), "--checkpoint", "0.002"]
        resume: list[str] = []
        while kills < wanted:
            moment = float(rng.uniform(0.2, 1.0)) * longest
            if not _killed([*command, *resume], moment, environment()):
                break
            kills += 1
            if (own / "a.checkpoint").exists():
                resume = ["--resume", str(own / "a.checkpoint")]
                gone_on += 1
        else:
            assert not _killed([*command, *resume], 600.0, environment())
        assert _bits(own / "a.exr") == wholes[name], f"{name}: other bits after {kills} kills"
    return f"{kills} kills of {rounds} renders, {gone_on} of them went on; the same bits"


def _bits(path: Path) -> bytes:
    image = Image.load(path)
    assert image.variance is not None
    return image.rgb.tobytes() + image.variance.tobytes()


def _convergence(folder: Path, quick: bool) -> str:
    """Convergence runs that are killed, with a cache of references of their own."""
    command = [*FURCL, "bench", "convergence", "single_fibre", "--quick", "--size", "12x12"]
    command += ["--spp", "4,8", "--runs", "3", "-o"]
    env = environment(FURCL_CACHE_DIR=str(folder / "cache"))
    began = time.monotonic()
    assert not _killed([*command, str(folder / "whole")], 600.0, env)
    longest = time.monotonic() - began
    rng, kills, runs = np.random.default_rng(2), 0, 0
    wanted = 1 if quick else N_KILLS_OF_CONVERGENCE
    while kills < wanted:
        runs += 1
        shutil.rmtree(folder / "cache")
        own = [*command, str(folder / str(runs))]
        while kills < wanted and _killed(own, float(rng.uniform(0.2, 0.9)) * longest, env):
            kills += 1
        assert not _killed(own, 600.0, env)
        assert _errors(folder / str(runs)) == _errors(folder / "whole"), "other results"
    return f"{kills} kills of {runs} runs, the same results"


def _errors(folder: Path) -> list[tuple[object, ...]]:
    rows = json.loads((folder / "results.json").read_text(encoding="utf-8"))["renders"]
    return [(row["variant"], row["spp"], row["seed"], row["mse"]) for row in rows]


def _caches_removed(name: str, folder: Path, quick: bool) -> str:
    """A cache that is removed again and again while renders start and run.

    Every second render finds that its device has passed the self-test.
    """
    told(furcl(*SMALL, "-o", folder / "whole.exr"), 0)
    caches = {n: folder / n for n in ("FURCL_CACHE_DIR", "POCL_CACHE_DIR")}
    said = []
    for n in range(1 if quick else 6):
        for path in caches.values():
            shutil.rmtree(path, ignore_errors=True)
            path.mkdir()
        env = environment(**{n: str(path) for n, path in caches.items()})
        if n % 2:
            told(furcl("devices", env=env), 0)
        # Without its cache PoCL has been seen to write bitcode where it runs, under any name.
        child = start([*FURCL, *SMALL, "-o", str(folder / f"{n}.exr")], env, cwd=folder)
        while child.poll() is None:
            time.sleep(0.05 + 0.1 * n)
            shutil.rmtree(caches[name], ignore_errors=True)
        err = child.communicate()[1]
        said.append(child.returncode)
        assert "Traceback" not in err, err[-300:]
        if child.returncode == 0:
            same = _bits(folder / f"{n}.exr") == _bits(folder / "whole.exr")
            assert same, "other bits"
            continue
        assert name.startswith("POCL"), f"code {child.returncode}: {err[-300:]}"
        if child.returncode < 0:  # what a process that crashed cannot say, the next one does
            err = furcl("info", "single_fibre", env=env).err
        assert name in err, f"does not say {name}: {err[-300:]}"
        assert child.returncode in (2, 3, -signal.SIGABRT), f"code {child.returncode}"
    return f"removed while {len(said)} renders run: codes {said}, the same bits where 0"


def _after_a_signal(folder: Path, quick: bool) -> str:
    """SIGTERM without --checkpoint: the picture so far and a checkpoint, from which it goes on."""
    base = [*FURCL, "-v", "render", "single_fibre", "--size", "64x64", "--spp"]
    child = start([*base, "100000", "-o", str(folder / "a.exr")], start_new_session=True)
    assert child.stderr
    next(line for line in child.stderr if "first samples" in line)
    time.sleep(0.3)
    os.kill(child.pid, signal.SIGTERM)
    err = child.communicate()[1]
    assert child.returncode == 143, f"code {child.returncode}: {err[-300:]}"
    done = Image.load(folder / "a.exr").stats["spp"]
    spp = str(done + 10)
    for name, more in {"b": ["--resume", str(folder / "a.checkpoint")], "c": []}.items():
        told(furcl(*base[len(FURCL) + 1 :], spp, *more, "-o", folder / f"{name}.exr"), 0)
    assert _bits(folder / "b.exr") == _bits(folder / "c.exr"), "other bits"
    return f"stopped at {done} samples a pixel, went on to {spp}: the same bits"


def _terminal_closed(folder: Path, quick: bool) -> str:
    """A terminal that goes away: SIGHUP, and a progress bar that nothing can be written to."""
    command = [*FURCL, "render", "single_fibre", "--size", "64x64", "--spp", "1000000", "-o"]
    child, terminal = pty.fork()
    if child == 0:
        os.execve(command[0], [*command, str(folder / "a.exr")], environment())
    said = b""
    while b"samples/s" not in said:
        said += os.read(terminal, 1 << 16)
    os.close(terminal)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code == 129, f"ended with {code}"
    left = sorted(path.name for path in folder.iterdir())
    assert left == ["a.checkpoint", "a.exr", "a.png"], f"left: {left}"
    return f"code {code}, {Image.load(folder / 'a.exr').stats['spp']} samples a pixel are written"


CASES = [
    Case("renders killed at every moment", _renders),
    Case("convergence runs killed at every moment", _convergence),
    Case("SIGTERM, and going on", _after_a_signal),
    Case("a terminal that is closed", _terminal_closed),
    *(
        Case(f"{words} removed under way", partial(_caches_removed, name))
        for words, name in (("furcl cache", "FURCL_CACHE_DIR"), ("PoCL cache", "POCL_CACHE_DIR"))
    ),
]
