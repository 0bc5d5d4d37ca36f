"""`furcl bench start`: from the command to the first samples, caches empty and caches full."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.record import circumstances, write_json
from furcl.device.choice import open_device
from furcl.errors import FurclError
from furcl.paths import python_command
from furcl.rendering.renderer import FIRST_SAMPLES

# Folders that furcl and what it uses keep between processes.
_CACHES = ("FURCL_CACHE_DIR", "POCL_CACHE_DIR", "NUMBA_CACHE_DIR")

_COMPILE_EVERYTHING = """
import sys
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene
renderer = Renderer(load_scene(sys.argv[1], size="16x16"), sys.argv[2], specialised=False)
renderer.advance(1)
print(renderer.seconds["compile"])
"""


def run(
    scene: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    device: str | None = None,
    size: str = "512x512",
    warm_runs: int = 5,
    overrides: Iterable[str] = (),
) -> dict[str, Any]:
    """Time `furcl render` in processes of their own. Writes results.json to `out`.

    The first run finds the caches of furcl and of the OpenCL runtime empty: it tests the device,
    simulates the medulla and compiles all kernels. The others find what it left. Python's compiled
    modules, which an installation makes, are there for all: a run before the first, with caches of
    its own, compiles them, whatever PYTHONDONTWRITEBYTECODE says.

    Returns
    -------
    dict    cold, warm: of each run seconds to the first finished samples, to the end of a
            picture of one sample a pixel (files written), and of its parts; warm_median;
            import_seconds: of `import furcl`; compile_everything_seconds: of the largest
            variant of the kernels, nothing cached

    Raises
    ------
    FurclError      if a run fails, with what it printed
    """
    opened = open_device(device)
    extra = [word for value in overrides for word in ("--set", value)]
    arguments = ["--size", size, "--spp", "1", *extra, *(["--device", device] if device else [])]
    with tempfile.TemporaryDirectory() as folder:
        modules = Path(folder) / "modules"
        environment = _environment(Path(folder) / "caches", modules)
        command = python_command("-m", "furcl", "-v", "render", os.fspath(scene), *arguments)
        _time(command, Path(folder), _environment(Path(folder) / "first caches", modules))
        runs = [_time(command, Path(folder), environment) for _ in range(1 + warm_runs)]
        largest = _print_of(
            python_command("-c", _COMPILE_EVERYTHING, os.fspath(scene), device or ""),
            _environment(Path(folder) / "other caches", modules),
        )
        imports = [_import_seconds(environment) for _ in range(warm_runs)]
    results = {
        **circumstances(opened),
        "scene": Path(scene).stem,
        "size": size,
        "cold": runs[0],
        "warm": runs[1:],
        "warm_median": float(np.median([run["first_samples"] for run in runs[1:]])),
        "import_seconds": float(np.median(imports)),
        "compile_everything_seconds": float(largest),
    }
    write_json(results, Path(out) / "results.json")
    return results


def _environment(caches: Path, modules: Path) -> dict[str, str]:
    """This process's environment with empty caches, Python's compiled modules in a folder, and this
    very furcl."""
    folders = {}
    for name in _CACHES:
        (caches / name).mkdir(parents=True)
        folders[name] = str(caches / name)
    here = str(Path(__file__).parents[2])
    path = os.pathsep.join(filter(None, (here, os.environ.get("PYTHONPATH", ""))))
    inherited = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return {**inherited, **folders, "PYTHONPYCACHEPREFIX": str(modules), "PYTHONPATH": path}


def _time(command: list[str], folder: Path, environment: dict[str, str]) -> dict[str, Any]:
    """Run a render; seconds until it says that it has samples, and until it ends."""
    stats = folder / "stats.json"
    command = [*command, "-o", str(folder / "picture.exr"), "--stats", str(stats)]
    start = time.perf_counter()
    lines, first = [], None
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, encoding="utf-8", env=environment
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            lines.append(line)
            if first is None and FIRST_SAMPLES in line:
                first = time.perf_counter() - start
    if process.returncode or first is None:
        raise FurclError(f"{' '.join(command)} failed:\n{''.join(lines[-20:])}")
    end = time.perf_counter() - start
    return {
        "first_samples": first,
        "end": end,
        "parts": json.loads(stats.read_text(encoding="utf-8"))["seconds"],
    }


def _import_seconds(environment: dict[str, str]) -> float:
    clock = "import time; start = time.perf_counter(); import furcl; "
    return float(
        _print_of(python_command("-c", clock + "print(time.perf_counter() - start)"), environment)
    )


def _print_of(command: list[str], environment: dict[str, str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode:
        raise FurclError(f"{' '.join(command)} failed:\n{done.stderr[-4000:]}")
    return done.stdout.splitlines()[-1]
