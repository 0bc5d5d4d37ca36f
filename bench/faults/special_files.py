"""What is no regular file where one is read: pipes, devices, files of the system, folders."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path

from faults.case import Case
from faults.harness import refused
from faults.scenes import SCENE
from furcl.errors import BenchError, FurclError, GroomError, ImageError, SamplerError, SceneError
from furcl.fibre import samplers
from furcl.groom import formats
from furcl.groom.formats import load_curves
from furcl.image.image import Image
from furcl.light.latlong import LatLong
from furcl.report.pages import write_pages
from furcl.scene.read import load_scene

HANGS_S = 20.0


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


def _folder(path: Path) -> None:
    path.mkdir()


def _empty(path: Path) -> None:
    path.touch()


def _link(target: str, path: Path) -> None:
    path.symlink_to(target)


_KINDS: dict[str, tuple[Callable[[Path], None], str]] = {
    "a pipe": (_pipe, "a pipe"),
    "a socket": (_socket, "a socket"),
    "a folder": (_folder, "a folder"),
    "an empty file": (_empty, "empty"),
    "/dev/zero": (partial(_link, "/dev/zero"), "a device"),
    # Reading it waits for the next message of the system.
    "/proc/kmsg": (partial(_link, "/proc/kmsg"), "empty"),
}


def _named_in_scene(key: str, path: Path) -> None:
    text = SCENE.replace("generator = 'fibre'", "file = 'a.hair'")
    scene = path.with_name("scene.toml")
    scene.write_text(text)
    changes = [f"curves.file={path}"]
    if key == "environment.file":
        changes = ["curves.generator=fibre", "environment.kind=image", f"environment.file={path}"]
    load_scene(scene, overrides=changes)


def _own_format(path: Path) -> None:
    formats.register(".strands", lambda path, radius: Path(path).read_bytes())  # pyright: ignore
    try:
        load_curves(path)
    finally:
        formats.unregister(".strands")


def _sampler(path: Path) -> None:
    samplers.register("own", path)


def _pages(path: Path) -> None:
    write_pages(path.parent)


_READERS: dict[str, tuple[str, Callable[[Path], object], type[FurclError]]] = {
    "a scene": ("scene.toml", load_scene, SceneError),
    "curves.file": ("a.hair", partial(_named_in_scene, "curves.file"), SceneError),
    "environment.file": ("a.exr", partial(_named_in_scene, "environment.file"), SceneError),
    ".hair": ("a.hair", load_curves, GroomError),
    ".npz": ("a.npz", load_curves, GroomError),
    "a groom of a format of one's own": ("a.strands", _own_format, GroomError),
    "a picture": ("a.exr", Image.load, ImageError),
    "a light": ("a.hdr", LatLong.load, ImageError),
    "a sampler": ("a.clh", _sampler, SamplerError),
    "results": ("results.json", _pages, BenchError),
}


def _read(name: str, kind: str, folder: Path, quick: bool) -> str:
    file, read, error = _READERS[name]
    make, words = _KINDS[kind]
    make(folder / file)

    def hangs(number: int, frame: object) -> None:
        raise TimeoutError(f"no end after {HANGS_S:.0f} s")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, HANGS_S)
    try:
        return refused(lambda: read(folder / file), error, words)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


CASES = [
    Case(f"{kind} as {name}", partial(_read, name, kind)) for name in _READERS for kind in _KINDS
]
