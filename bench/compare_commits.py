"""Speed of one commit beside another's: renders, rays, start and compilation.

    python bench/compare_commits.py OLD NEW SCENE... [--groom GROOM]... [--device D] [-o FILE.json]

Both are checked out into a temporary folder, with caches of their own, and driven by what users
have: the command line and furcl.Renderer. They take turns, OLD NEW NEW OLD ..., so that a machine
whose speed drifts treats both alike; printed are medians of how many times faster NEW is, with
95 % intervals. By processor seconds the ratios are steadier where others use the machine; those of
rays are of the rate over Embree's in the same process.

SCENE is the name of a scene of both commits or a path, GROOM what `furcl bench intersect` takes.
Without --only everything is measured: half an hour for three scenes and four grooms.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.pairs import alternating, median_interval

SIDES = ("old", "new")

# Renders as many samples as each line asks for and says how long that took. Commits that measured
# the size of waves did so on their first samples.
RENDER = """
import json, sys, time, furcl
scene, device, size = sys.argv[1:]
renderer = furcl.Renderer(furcl.load_scene(scene, size=size), device or None)
renderer.advance(2)
while renderer.stats()["wave_size_from"] == "first guess":
    renderer.advance(1)
print("ready", flush=True)
for line in sys.stdin:
    wall, cpu = time.perf_counter(), time.process_time()
    renderer.advance(int(line))
    print("took", time.perf_counter() - wall, time.process_time() - cpu, flush=True)
"""

# Compiles kernels with everything on.
COMPILE = """
import sys, furcl
scene = furcl.load_scene(sys.argv[1], size="16x16")
renderer = furcl.Renderer(scene, sys.argv[2] or None, specialised=False)
print("took", renderer.seconds["compile"])
"""

Pair = tuple[float, float]  # wall and processor seconds, or the like


class Side:
    """A commit in a folder of its own."""

    def __init__(self, folder: Path, commit: str, device: str) -> None:
        self.root, self.caches, self.device = folder / "tree", folder / "caches", device
        here = Path(__file__).parents[1]
        for command in (
            ["git", "clone", "--quiet", "--shared", "--no-checkout", str(here), str(self.root)],
            ["git", "-C", str(self.root), "checkout", "--quiet", "--detach", commit],
        ):
            subprocess.run(command, check=True)
        self.environment = {
            **os.environ,
            "PYTHONPATH": str(self.root),
            **{f"{name}_CACHE_DIR": str(self.caches / name) for name in ("FURCL", "POCL", "NUMBA")},
            "OPENBLAS_NUM_THREADS": "1",
        }
        self.forget("FURCL", "POCL", "NUMBA")

    def forget(self, *caches: str) -> None:
        """Empty caches; FURCL/kernels is one too."""
        for name in caches:
            shutil.rmtree(self.caches / name, ignore_errors=True)
            (self.caches / name).mkdir(parents=True)

    def scene(self, name: str) -> str:
        """A scene of the commit, or any by its path."""
        own = self.root / "scenes" / f"{name}.toml"
        return str(own if own.is_file() else Path(name).absolute())

    def python(self, *arguments: str) -> list[str]:
        """A command of this Python."""
        return [sys.executable, *arguments]

    def run(self, *arguments: str) -> tuple[str, Pair]:
        """Run Python; what it prints, and its wall and processor seconds."""
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(
            self.python(*arguments),
            env=self.environment,
            cwd=self.root,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise SystemExit(f"{' '.join(arguments[:4])} fails in {self.root}:\n{done.stderr}")
        wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return done.stdout, (wall, cpu)

    def furcl(self, *arguments: str) -> Pair:
        """Run the command furcl on the device; its wall and processor seconds."""
        device = ["--device", self.device] if self.device else []
        return self.run("-m", "furcl", "-q", *arguments, *device)[1]


@contextmanager
def renderer(side: Side, scene: str, size: str, spp: int) -> Iterator[Callable[[], Pair]]:
    """A process with a scene on its device; each call adds samples."""
    command = side.python("-c", RENDER, side.scene(scene), side.device, size)
    with subprocess.Popen(
        command,
        env=side.environment,
        cwd=side.root,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None

        def answer() -> list[str]:
            for line in process.stdout or ():
                if line.startswith(("ready", "took")):
                    return line.split()[1:]
            raise SystemExit(f"{scene} does not render in {side.root}")

        def advance() -> Pair:
            process.stdin.write(f"{spp}\n")  # pyright: ignore[reportOptionalMemberAccess]
            process.stdin.flush()  # pyright: ignore[reportOptionalMemberAccess]
            wall, cpu = map(float, answer())
            return wall, cpu

        answer()
        yield advance
        process.stdin.close()


def start(side: Side, scene: str) -> Callable[[], Pair]:
    """Whole processes that render one sample, with full caches."""
    picture = str(side.caches / "picture.exr")
    arguments = ["render", side.scene(scene), "--size", "64x64", "--spp", "1", "-o", picture]
    side.furcl(*arguments)
    return lambda: side.furcl(*arguments)


def compilation(side: Side, scene: str) -> Callable[[], Pair]:
    """The build with everything on, without caches of kernels: its wall, its process's cpu."""

    def run() -> Pair:
        side.forget("POCL", "FURCL/kernels")
        printed, (_, cpu) = side.run("-c", COMPILE, side.scene(scene), side.device)
        return float(printed.split("took")[-1]), cpu

    run()
    return run


def rays(side: Side, groom: str, rounds: int) -> Callable[[], dict[str, Pair]]:
    """By kind of rays seconds for a million, and processor seconds over Embree's."""
    name, out = groom if ":" in groom else side.scene(groom), side.caches / "rays"

    def run() -> dict[str, Pair]:
        side.furcl("bench", "intersect", name, "-o", str(out), "--rounds", str(rounds))
        found = json.loads((out / "results.json").read_text())["rays"]
        return {
            row["kind"]: (1.0 / row["mrays_s"], 1.0 / (row["cpu_ratio"] or row["ratio"]))
            for row in found
        }

    return run


def ratios(pairs: dict[str, list[Pair]]) -> list[dict[str, Any]]:
    """Medians of old over new, by wall and by processor seconds."""
    old, new = (np.array(pairs[side]) for side in SIDES)
    return [asdict(median_interval(column)) for column in (old / new).T]


def take_turns(measure: dict[str, Callable[[], Any]], rounds: int) -> dict[str, list[Any]]:
    """What both measure in every round."""
    found: dict[str, list[Any]] = {side: [] for side in SIDES}
    for side in alternating(SIDES, rounds):
        found[side].append(measure[side]())
    return found


Rows = Iterator[dict[str, Any]]


def renders(sides: dict[str, Side], options: argparse.Namespace) -> Rows:
    """Samples added by two processes that have all set up."""
    for scene in options.scenes:
        with (
            renderer(sides["old"], scene, options.size, options.spp) as old,
            renderer(sides["new"], scene, options.size, options.spp) as new,
        ):
            found = take_turns({"old": old, "new": new}, options.rounds)
        yield row(f"render {scene}", found)


def all_rays(sides: dict[str, Side], options: argparse.Namespace) -> Rows:
    """Every kind of rays through every groom."""
    for groom in options.groom:
        measure = {name: rays(side, groom, options.ray_rounds) for name, side in sides.items()}
        found = take_turns(measure, options.processes)
        for kind in found["old"][0]:
            of_kind = {name: [run[kind] for run in runs] for name, runs in found.items()}
            yield row(f"rays {groom}, {kind}", of_kind)


def starts(sides: dict[str, Side], options: argparse.Namespace) -> Rows:
    """From the command to a small picture."""
    for scene in options.scenes:
        measure = {name: start(side, scene) for name, side in sides.items()}
        yield row(f"warm start {scene}", take_turns(measure, 2 * options.processes))


def compilations(sides: dict[str, Side], options: argparse.Namespace) -> Rows:
    """The largest variant of the kernels."""
    measure = {name: compilation(side, options.largest) for name, side in sides.items()}
    yield row("compile everything on", take_turns(measure, options.processes))


PARTS = {"renders": renders, "rays": all_rays, "starts": starts, "compilation": compilations}


def row(name: str, found: dict[str, list[Pair]]) -> dict[str, Any]:
    """A measurement as values, printed as it is made."""
    wall, cpu = ratios(found)
    seconds = {side: float(np.median([pair[0] for pair in found[side]])) for side in SIDES}
    cells = [name, *(f"{seconds[side]:.3g}" for side in SIDES), *map(shown, (wall, cpu))]
    print("| " + " | ".join(cells) + " |", flush=True)
    return {"name": name, "seconds": seconds, "ratio": wall, "cpu_ratio": cpu}


def shown(found: dict[str, Any]) -> str:
    """A median with its interval."""
    ends = "" if found["low"] is None else f" [{found['low']:.3f}, {found['high']:.3f}]"
    return f"{found['median']:.3f}{ends}"


def main() -> None:
    """Compare, print, and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--groom", action="append", default=[], help="for rays; may be repeated")
    parser.add_argument("--device", default="", help="number or part of a name")
    parser.add_argument("--size", default="256x256", help="of renders [px]")
    parser.add_argument("--spp", type=int, default=2, help="samples a pixel of a turn")
    parser.add_argument("--rounds", type=int, default=31, help="turns of renders")
    parser.add_argument("--processes", type=int, default=9, help="turns of whole processes")
    parser.add_argument("--ray-rounds", type=int, default=5, help="rounds in such a process")
    parser.add_argument(
        "--largest", default="red_fox", help="scene of the build with everything on"
    )
    parser.add_argument("--only", action="append", choices=PARTS, help="may be repeated")
    parser.add_argument("-o", "--out", type=Path, help="JSON file")
    options = parser.parse_args()
    print("| measured | old, s | new, s | times faster | by processor seconds |")
    print("| --- | ---: | ---: | ---: | ---: |", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        sides = {
            name: Side(Path(folder) / name, getattr(options, name), options.device)
            for name in SIDES
        }
        rows = [row for part in options.only or PARTS for row in PARTS[part](sides, options)]
    if options.out:
        options.out.write_text(json.dumps({"command": sys.argv, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
