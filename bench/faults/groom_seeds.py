"""Small whole grooms of every format that furcl has, for mutants to damage."""

from __future__ import annotations

import gzip
import io
import os
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from faults.harness import in_fork
from furcl.errors import GroomError

RNG = np.random.default_rng(1)
POINTS = RNG.random((9, 3)).astype("<f4")
OFFSETS = [0, 3, 5, 9]
CPU_SECONDS = 20


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
    """Read a file as `furcl.load_curves` does, USD by a fork."""
    from furcl.groom.formats import load_curves

    if kind.startswith("usd"):
        read_usd_by_fork()
    load_curves(path, **SEEDS[kind][2])


def read_usd_by_fork() -> None:
    """Let this process read USD by forks of itself from now on."""
    from furcl.groom.formats import usd

    usd.extracted = _by_fork


def _by_fork(path: Path, what: str = "curves") -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """As furcl.groom.formats.usd reads a file, but by a fork of this process, which has loaded
    usd-core and never used it: that is a hundred times faster than another process."""
    import resource

    from pxr import Usd, UsdGeom, UsdShade  # noqa: F401

    from furcl.groom.formats import usd, usd_stage
    from furcl.memory import limit_memory

    file = os.memfd_create("mutant")

    def within_limits() -> None:
        limit_memory(usd.memory_bytes(path))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
        with os.fdopen(os.dup(file), "wb") as shared:
            usd_stage.write_result(str(path), shared, what)

    status = in_fork(within_limits)
    try:
        if status:
            raise GroomError(f"usd-core ends with {os.waitstatus_to_exitcode(status)}")
        return usd.shared_result(file)
    finally:
        os.close(file)
