"""Outputs: full disks, partial pictures, lost logs, names that are paths, films that are large."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from faults.case import Case
from faults.harness import FURCL, SMALL, Ended, environment, furcl, run, told
from furcl.errors import SceneError
from furcl.image.image import Image
from furcl.scene.read import load_scene, with_overrides

FILM_BYTES = 20  # of a pixel in grey: four sums, and the number of samples
PAGE = 4096  # bytes in which a disk in memory is filled
SIDE = 4096  # of a large film [pixels]
MOST_FILMS = 3.0  # memory of a whole render, over that of its film

# Run a command with a disk of so many bytes in a folder, and copy what is on it then to another.
_ON_A_SMALL_DISK = """
set -e; disk=$1; size=$2; after=$3; shift 3; keep=$(mktemp -d); cp -a "$disk/." "$keep"
mount -t tmpfs -o size=$size none "$disk"; cp -a "$keep/." "$disk"; rm -r "$keep"
code=0; "$@" || code=$?; cp -a "$disk/." "$after"; exit $code
"""


def on_a_small_disk(
    disk: Path, n_bytes: int, after: Path, command: Sequence[object], env: dict[str, str]
) -> Ended | None:
    """Run furcl with a folder on a disk of its own, which holds what the folder held; None where
    this process may not mount one. What is on the disk at the end is in `after`."""
    after.mkdir()
    own = ["unshare", "--mount", "sh", "-c"]
    if shutil.which("unshare") is None or run([*own, "mount -t tmpfs none /mnt"]).code:
        return None
    arguments = [str(disk), str(n_bytes), str(after), *FURCL, *map(str, command)]
    return run([*own, _ON_A_SMALL_DISK, "sh", *arguments], env)


NAMES = ("../../up", "a|b", r"$\frac$")
NO_MOUNT = "not tried: no right to mount a disk"


def _full_while_saving(suffix: str, folder: Path, quick: bool) -> str:
    """All but the last page of the picture has room: the older one stays, nothing else is left,
    and the message names the picture."""
    disk, after = folder / "disk", folder / "after"
    disk.mkdir()
    command = ["render", "single_fibre", "--size", "256x256", "--spp", "2", "-o"]
    told(furcl(*command, folder / f"whole{suffix}"), 0)
    pages = -(-(folder / f"whole{suffix}").stat().st_size // PAGE)
    path = disk / f"a{suffix}"
    Image(np.ones((4, 4, 3), np.float32)).save(path)
    old = path.read_bytes()
    # The old picture has a page.
    ended = on_a_small_disk(disk, pages * PAGE, after, [*command, path], environment())
    if ended is None:
        return NO_MOUNT
    said = told(ended, 2, str(path))
    assert ".furcl-" not in said, f"names the temporary file: {said}"
    left = sorted(p.name for p in after.iterdir())
    assert left == [path.name], f"left: {left}"
    assert (after / path.name).read_bytes() == old, "the older picture is lost"
    return said


def _full_while_caching(name: str, folder: Path, quick: bool) -> str:
    """The same picture, or a message that names the folder."""
    cache, after = folder / "cache", folder / "after"
    cache.mkdir()
    told(furcl(*SMALL, "-o", folder / "whole.exr"), 0)
    env = environment(**{name: str(cache)})
    ended = on_a_small_disk(cache, 16384, after, [*SMALL, "-o", folder / "a.exr"], env)
    if ended is None:
        return NO_MOUNT
    if name == "POCL_CACHE_DIR" and ended.code:
        return told(ended, 3, name)
    said = told(ended, 0, *([name] if name.startswith("FURCL") else []))
    found, whole = (Image.load(folder / name).rgb for name in ("a.exr", "whole.exr"))
    assert np.array_equal(found, whole), "other bits"
    return f"the same bits; {said}"


def _threads_save(folder: Path, quick: bool) -> str:
    """Threads that save pictures at once, under names of their own and under one."""
    rng, n = np.random.default_rng(1), 4 if quick else 16
    images = [Image(rng.random((64, 64, 3), np.float32)) for _ in range(n)]
    names = [f"{i}{s}" for i in range(n) for s in (".exr", ".png")] + ["one.exr"] * n
    before = os.fstat(2).st_ino
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(lambda k: images[k % n].save(folder / names[k]), range(len(names))))
    assert os.fstat(2).st_ino == before, "standard error is another"
    pixels = {image.rgb.tobytes() for image in images}
    loaded = {Image.load(path).rgb.tobytes() for path in folder.glob("*.exr")}
    assert loaded <= pixels, "a picture that nobody saved"
    left = [path.name for path in folder.iterdir() if path.name.startswith(".")]
    assert not left, f"left: {left}"
    return f"{len(names)} pictures by 8 threads, each as it was saved"


def _partial(folder: Path, quick: bool) -> str:
    path = folder / "a.exr"
    told(furcl(*SMALL, "-o", path), 0)
    old = path.read_bytes()
    ended = furcl(*SMALL, "--wave-size", 9, "--time-limit", "0", "-o", path)
    said = told(ended, 0, "a.partial.exr", "is left as it was")
    assert path.read_bytes() == old, "the older picture is lost"
    assert np.isfinite(Image.load(folder / "a.partial.exr").rgb).all()
    return said


def _lost_log(redirection: str, folder: Path, quick: bool) -> str:
    command = ["sh", "-c", f'"$@" {redirection}', "sh", *FURCL, "-v", *SMALL, "-o"]
    ended = run([*command, str(folder / "a.exr")])
    told(ended, 0)
    assert Image.load(folder / "a.exr").rgb.any()
    return "the picture is there, code 0"


def _name(name: str, folder: Path, quick: bool) -> str:
    inner = folder / "a" / "b"
    inner.mkdir(parents=True)
    command = ["bench", "convergence", "single_fibre", "--set", f"name={json.dumps(name)}"]
    command += ["--quick", "--size", "8x8", "--spp", "2,4", "--runs", "2", "-o", inner / "out"]
    said = told(furcl(*command), 0)
    outside = [p for p in folder.rglob("*") if p.is_file() and inner / "out" not in p.parents]
    assert not outside, f"written outside: {outside}"
    return said


def _unreadable_name(folder: Path, quick: bool) -> str:
    scene = load_scene("single_fibre")
    try:
        with_overrides(scene, ['name="a\\nb"'])
    except SceneError as error:
        return str(error)
    raise AssertionError("accepted")


def _same_file(folder: Path, quick: bool) -> str:
    path = folder / "a.exr"
    said = told(furcl(*SMALL, "-o", path, "--stats", path), 2, "--stats")
    assert not path.exists()
    return said


def _old_folder(change: Sequence[str], folder: Path, quick: bool) -> str:
    command = ["bench", "convergence", "single_fibre", "--quick", "--size", "8x8", "--spp", "2,4"]
    command += ["--runs", "2", "-o", folder / "out"]
    told(furcl(*command), 0)
    return told(furcl(*command, *change), 2, "give another folder")


def _large_film(folder: Path, quick: bool) -> str:
    """From the film on the device to the files: what that takes beside a small render."""
    size = 512 if quick else SIDE
    command = ["render", "single_fibre", "--spp", "2", "--set", "camera.vfov_deg=170"]
    small = furcl(*command, "--size", "16x16", "-o", folder / "b.exr").peak_bytes
    ended = furcl(*command, "--size", f"{size}x{size}", "-o", folder / "a.exr")
    told(ended, 0)
    assert "colour" in ended.err.partition("left out:")[2], "the film is not grey"
    films = (ended.peak_bytes - small) / (FILM_BYTES * size * size)
    assert quick or films <= MOST_FILMS, f"{films:.2f} times the film"
    return (
        f"{size} x {size} pixels take {films:.2f} times the film, {ended.peak_bytes / 1e6:.0f} MB"
    )


COLOUR = ("--set", "fibre.sigma_ca=[0.1, 0.2, 0.3]")
#: What is set, the layers, and bytes of a pixel: sums of three colours have FILM_BYTES + 32, a plan
#: has 8 and 8 a level, each sum of a layer 8, each of twelve ids 8.
VARIANTS: dict[str, tuple[tuple[str, ...], tuple[str, ...], int]] = {
    "in colour": (COLOUR, (), 52),
    "in colour, planned": ((*COLOUR, "--set", "render.allocation=adaptive"), (), 68),
    "with layers of first hits": ((), ("alpha", "depth", "position", "normal", "strand_u"), 100),
    "with layers of light": (COLOUR, ("albedo", "direct", "indirect"), 52 + 72),
    "with numbers of strands": ((), ("strand", "groom", "samples"), 28),
    "with a matte": ((), ("cryptomatte_groom",), 116),
}


def _other_film(name: str, folder: Path, quick: bool) -> str:
    """As the grey film without layers: read, converted and written by strips."""
    changes, layers, pixel_bytes = VARIANTS[name]
    if quick:
        return "at full size only"
    command = ["render", "single_fibre", "--spp", "2", "--set", "camera.vfov_deg=170", *changes]
    command += ["--set", f"film.layers={json.dumps(layers)}"]
    small = furcl(*command, "--size", "16x16", "-o", folder / "b.exr").peak_bytes
    ended = furcl(*command, "--size", f"{SIDE}x{SIDE}", "-o", folder / "a.exr")
    told(ended, 0)
    films = (ended.peak_bytes - small) / (pixel_bytes * SIDE**2)
    assert films <= MOST_FILMS, f"{films:.2f} times the film"
    return f"{pixel_bytes} bytes a pixel take {films:.2f} times the film"


def _large_limit(folder: Path, quick: bool) -> str:
    """An older picture that is a folder, and one whose name no system takes."""
    said = ""
    for name in ("a.exr", "x" * 251 + ".exr"):
        path = folder / name
        if name == "a.exr":
            path.mkdir()
        ended = furcl(*SMALL, "-o", path)
        assert "compiled in" not in ended.err, "told after the render"
        said = told(ended, 2)
    return said


CASES = [
    *(Case(f"full disk, saving {s}", partial(_full_while_saving, s)) for s in (".exr", ".png")),
    Case("full disk, furcl cache", partial(_full_while_caching, "FURCL_CACHE_DIR")),
    Case("full disk, PoCL cache", partial(_full_while_caching, "POCL_CACHE_DIR")),
    Case("threads that save at once", _threads_save),
    Case("a part of a picture in place of a whole one", _partial),
    *(
        Case(f"a log that is lost: {words}", partial(_lost_log, words))
        for words in ("2>&-", "2>/dev/full", "0<&- 1>&- 2>&-", "2>&1 | true")
    ),
    *(
        Case(f"a scene called {name}", partial(_name, name))
        for name in ("../../up", "a|b", r"$\frac$")
    ),
    Case("a scene whose name no line shows", _unreadable_name),
    Case("statistics in place of the picture", _same_file),
    Case("a folder, and a name too long, as output", _large_limit),
    *(
        Case(f"convergence in an old folder with {' '.join(change)}", partial(_old_folder, change))
        for change in (("--seed", "2"), ("--reference-spp", "128"))
    ),
    Case("a film of 4096 x 4096 pixels", _large_film),
    *(
        Case(f"a film of 4096 x 4096 pixels {name}", partial(_other_film, name))
        for name in VARIANTS
    ),
]
