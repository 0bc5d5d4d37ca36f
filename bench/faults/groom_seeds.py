"""Small whole grooms of every format that furcl has, for mutants to damage."""

from __future__ import annotations

import gzip
import io
import mmap
import os
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from faults.harness import in_fork
from furcl.errors import GroomError

RNG = np.random.default_rng(1)
POINTS = RNG.random((9, 3)).astype("<f4")
OFFSETS = [0, 3, 5, 9]
CPU_SECONDS = 20

# Of a USD file that forks read: not yet, at it, or how it failed.
_WAITS, _READ_NOW, _RAISES, _ENDS = 255, 254, 253, 252
_FAILED = {_RAISES: "raises an error of Python's", _ENDS: "ends the process"}


def written(suffix: str, folder: Path) -> bytes:
    """By furcl's writer."""
    from furcl.groom.curves import Curves
    from furcl.groom.formats import save_curves

    values = {"colours": RNG.random((3, 3)), "melanin": RNG.random(9)}
    if suffix == ".txt":
        values = {}
    path = folder / f"seed{suffix}"
    save_curves(Curves.from_arrays(POINTS, RNG.random(9) + 0.1, OFFSETS, attributes=values), path)
    return path.read_bytes()


def control_points(folder: Path) -> bytes:
    """Text of two strands of nine points."""
    rows = "".join(f"{x:.3f} {y:.3f} {z:.3f} 0.1\n" for x, y, z in POINTS)
    return f"{rows}\n{rows}".encode()


def ascii_ply(folder: Path) -> bytes:
    """With edges and whole numbers as colours."""
    head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
    head += "property float z\nproperty float width\nproperty uchar red\nproperty uchar green\n"
    head += "property uchar blue\nelement edge 3\nproperty int vertex1\nproperty int vertex2\n"
    rows = "".join(f"{i} {i * i} 0.5 0.1 255 {i} 7\n" for i in range(5))
    return (head + "end_header\n" + rows + "0 1\n2 3\n3 4\n").encode()


def tfx(folder: Path) -> bytes:
    """Version 4, with thickness and colours."""
    head = struct.pack("<f2I5I", 4.0, 2, 4, 160, 0, 0, 288, 296) + bytes(128)
    return head + RNG.random(32 + 2 + 32).astype("<f4").tobytes()


def tfx_text(folder: Path) -> bytes:
    """Version 2."""
    rows = "".join(
        f"strand {s} numVerts 3 texcoord 0.5 0.5\n" + f"0 {s} 0\n0 {s} 1\n0 {s} 2.5\n"
        for s in range(3)
    )
    return ("version 2.0\nscale 1.5\nnumStrands 3\n" + rows).encode()


def salon(folder: Path) -> bytes:
    """A .data file of three strands, one of a point."""
    parts = [struct.pack("<i", n) + POINTS[:n].tobytes() for n in (4, 1, 3)]
    return struct.pack("<i", 3) + b"".join(parts)


def npy(folder: Path) -> bytes:
    """Strands of equally many points, with radii."""
    file = io.BytesIO()
    np.save(file, RNG.random((3, 4, 4)).astype(np.float32))
    return file.getvalue()


def pbrt(folder: Path) -> bytes:
    """Curves of both bases, transformations and lists."""
    numbers = " ".join(f"{x:.3f}" for x in RNG.random(21))
    return f"""# curves
Scale 2 2 2
WorldBegin
AttributeBegin
Translate 1 0 0 Rotate 30 0 1 0
Shape "curve" "string type" ["flat"] "point3 P" [{numbers}] "float width0" [0.1] "float width1" 0.2
AttributeEnd
Shape "curve" "string basis" "bspline" "integer degree" [2] "point P" [{numbers}] "float width" 0.1
Shape "sphere" "float radius" 1
""".encode()


def packed_pbrt(folder: Path) -> bytes:
    """The same by gzip."""
    return gzip.compress(pbrt(folder), mtime=0)


def usda(folder: Path) -> bytes:
    """Cubic curves, with a transformation and time samples."""
    points = ", ".join(f"({x:.3f}, {y:.3f}, {z:.3f})" for x, y, z in RNG.random((8, 3)))
    return f"""#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
def Xform "x"
{{
    double3 xformOp:translate = (1, 2, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def BasisCurves "a"
    {{
        uniform token type = "cubic"
        uniform token basis = "bspline"
        uniform token wrap = "pinned"
        int[] curveVertexCounts = [4, 4]
        point3f[] points.timeSamples = {{ 1: [{points}], 2: [{points}] }}
        float[] widths = [0.1, 0.2] (interpolation = "uniform")
        color3f[] primvars:displayColor = [(1, 0, 0)] (interpolation = "constant")
    }}
}}
""".encode()


def usd_mesh() -> bytes:
    """A square and a triangle, with normals and texture coordinates."""
    points = "(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 1.5, 0)"
    normals = ", ".join(5 * ["(0, 0, 1)"])
    return f"""#usda 1.0
def Mesh "m"
{{
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4]
    int[] holeIndices = [1]
    point3f[] points = [{points}]
    normal3f[] normals = [{normals}] (interpolation = "vertex")
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 2)] (interpolation = "vertex")
    uniform token orientation = "leftHanded"
    double3 xformOp:scale = (1, 2, 3)
    uniform token[] xformOpOrder = ["xformOp:scale"]
}}
""".encode()


#: Kind -> suffix, what makes a whole file in a folder, and options of `load_curves`.
SEEDS: dict[str, tuple[str, Callable[[Path], bytes], dict[str, Any]]] = {
    "ply": (".ply", lambda folder: written(".ply", folder), {}),
    "ply ascii": (".ply", ascii_ply, {}),
    "mitsuba": (".txt", lambda folder: written(".txt", folder), {}),
    "mitsuba cubic": (".txt", control_points, {"basis": "catmull-rom"}),
    "tfx": (".tfx", tfx, {}),
    "tfx text": (".tfx", tfx_text, {"default_radius": 0.1}),
    "data": (".data", salon, {"default_radius": 0.1}),
    "npy": (".npy", npy, {}),
    "pbrt": (".pbrt", pbrt, {}),
    "pbrt.gz": (".pbrt.gz", packed_pbrt, {}),
    "usda": (".usda", usda, {}),
    "usdc": (".usdc", lambda folder: written(".usdc", folder), {}),
}


@cache
def seed(kind: str, folder: Path) -> bytes:
    """A whole file of a kind."""
    return SEEDS[kind][1](folder)


def read(kind: str, path: Path) -> None:
    """Read a file as `furcl.load_curves` does."""
    from furcl.groom.formats import load_curves

    load_curves(path, **SEEDS[kind][2])


@contextmanager
def usd_read_together(paths: list[Path]) -> Iterator[None]:
    """Within it this process reads these USD files by forks of itself, each file once.

    The forks are of a process that has loaded usd-core and never used it: its first file takes
    longer than a hundred more, so a fork reads one file after the other.
    """
    from furcl.groom.formats import usd

    ended: dict[tuple[Path, str], _Ended] = {}

    def extracted(path: Path, what: str = "curves"):
        if (path, what) not in ended:
            ended.update({(each, what): end for each, end in _by_forks(paths, what)})
        end = ended[path, what]
        if end.code:
            raise GroomError(f"usd-core {_FAILED.get(end.code, f'dies of signal {end.code}')}")
        return usd.shared_result(end.file)

    before, usd.extracted = usd.extracted, extracted
    try:
        yield
    finally:
        usd.extracted = before
        for end in ended.values():
            os.close(end.file)


class _Ended(NamedTuple):
    """How the reading of a file ended, 0 being well, else a signal or one of _FAILED; and the open
    file that holds its result."""

    code: int
    file: int


def _by_forks(paths: list[Path], what: str) -> Iterator[tuple[Path, _Ended]]:
    """As furcl.groom.formats.usd reads files; where a fork dies another goes on after its file."""
    from pxr import Usd, UsdGeom, UsdShade  # noqa: F401

    from furcl.groom.formats import usd
    from furcl.memory import limit_memory

    files = [os.memfd_create("mutant") for _ in paths]
    codes = mmap.mmap(-1, len(paths))
    codes[:] = bytes([_WAITS]) * len(paths)

    whole = [path for path in paths if path.stat().st_size]

    def read_on() -> None:
        limit_memory(max(map(usd.memory_bytes, whole), default=usd.SLACK_BYTES))
        for i in range(codes[:].index(_WAITS), len(paths)):
            codes[i] = _READ_NOW
            codes[i] = _within_seconds(paths[i], files[i], what)

    while _WAITS in codes[:]:
        status = in_fork(read_on)
        if status:
            codes[codes[:].index(_READ_NOW)] = os.WTERMSIG(status) or _ENDS
    yield from zip(paths, map(_Ended, codes[:], files), strict=True)


def _within_seconds(path: Path, file: int, what: str) -> int:
    import resource

    from furcl.groom.formats import usd_stage

    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime) + CPU_SECONDS
    # Only root may raise the hard limit, which the caller may have set.
    resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    try:
        with os.fdopen(os.dup(file), "wb") as shared:
            usd_stage.write_result(str(path), shared, what)
    except Exception:
        return _RAISES
    return 0
