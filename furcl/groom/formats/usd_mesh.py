"""Meshes of USD stages, beside those that furcl.surface.mesh.read knows."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import GroomError, MeshError
from furcl.files import check_regular, named
from furcl.groom.formats import usd
from furcl.groom.orient import turned
from furcl.surface.mesh import read
from furcl.surface.mesh.read import MeshArrays

Array = NDArray[Any]


def turns_itself(path: Path) -> bool:
    """Whether a mesh file says what is up, so that `read_mesh` turns it."""
    return path.suffix.lower() in usd.FORMAT.suffixes


def has_meshes(path: Path) -> bool:
    """Whether a groom file has visible meshes beside its strands; a file that cannot be read has
    none."""
    if not turns_itself(path):
        return False
    try:
        check_regular(path)
        said, _ = usd.extracted(path, "kinds")
    except (OSError, GroomError):
        return False
    return bool(said.get("has_meshes"))


def read_mesh(path: str | os.PathLike[str]) -> MeshArrays:
    """Read a mesh file: of USD all visible meshes of the stage, else as `surface.mesh.read`.

    USD says what is up: its meshes are turned to stand along z, as the strands of the same file
    are. Every corner of a triangle has a vertex of its own. Polygons are cut into triangles from
    their first corner; subdivision surfaces are their cages; holes are left out. Values that change
    with time are the first ones. Materials are not used.

    Raises
    ------
    MeshError       the file and prim, and what to do
    """
    path = named(path, MeshError)
    if not turns_itself(path):
        return read.read_mesh(path)
    try:
        check_regular(path)
        said, arrays = usd.extracted(path, "meshes")
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror}; give a mesh") from None
    except GroomError as error:
        raise MeshError(str(error)) from None
    if "error" in said:
        raise MeshError(f"{path}: usd-core cannot read it: {said['error']}; export it again")
    if not said["meshes"]:
        raise MeshError(f"{path}: has no visible meshes; export them with the strands")
    parts = [_mesh(mesh, number, arrays, path) for number, mesh in enumerate(said["meshes"])]
    vertices = np.concatenate([part[0] for part in parts])
    normals, places = (_of_all([part[k] for part in parts]) for k in (1, 2))
    if not len(vertices):
        raise MeshError(f"{path}: has no triangles; give a file with faces")
    faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
    axis = said["up_axis"]
    if normals is not None:
        normals = turned(normals, axis)
    return MeshArrays(turned(vertices, axis), faces, normals=normals, places=places)


def _of_all(values: Sequence[Array | None]) -> Array | None:
    """The values of all prims together, none where one has none."""
    given = [array for array in values if array is not None]
    return np.concatenate(given) if len(given) == len(values) else None


def _mesh(mesh, number: int, arrays, path) -> tuple[Array, Array | None, Array | None]:
    """Vertices, normals and places of the corners of the triangles of a prim."""
    where = f"{path}: {mesh['path']}"
    points, counts, indices = (arrays[f"{number}/{n}"] for n in ("points", "counts", "indices"))
    if (counts < 0).any() or counts.sum() != len(indices):
        raise MeshError(
            f"{where}: faceVertexCounts add up to {counts.sum()}, and there are {len(indices)} "
            f"faceVertexIndices; export the mesh again"
        )
    if len(indices) and not (indices.min() >= 0 and indices.max() < len(points)):
        raise MeshError(
            f"{where}: faceVertexIndices go from {indices.min()} to {indices.max()}, and there are "
            f"{len(points)} points; export the mesh again"
        )
    solid = np.ones(len(counts), bool)
    holes = arrays[f"{number}/holes"]
    solid[holes[(holes >= 0) & (holes < len(counts))]] = False
    face, corners = _fans(counts, solid)
    if mesh["turned"]:
        corners = corners[:, ::-1]
    sizes = {"constant": 1, "uniform": len(counts), "vertex": len(points), "varying": len(points)}
    sizes["faceVarying"] = len(indices)

    def at_corners(name: str) -> Array | None:
        """Values (3 n, ...) of the corners, None where there are none or not so many as said."""
        kind = mesh[name]
        if kind is None or len(arrays[f"{number}/{name}"]) != sizes.get(kind):
            return None
        values = arrays[f"{number}/{name}"]
        if kind == "constant":
            return np.broadcast_to(values[0], (corners.size, values.shape[1]))
        if kind == "uniform":
            return np.repeat(values[face], 3, axis=0)
        return values[(corners if kind == "faceVarying" else indices[corners]).ravel()]

    return points[indices[corners.ravel()]], at_corners("normals"), at_corners("places")


def _fans(counts: Array, solid: Array) -> tuple[Array, Array]:
    """Triangles of polygons: the polygon of each (n,), and its corners (n, 3) among all corners."""
    n = np.where(solid, np.maximum(counts - 2, 0), 0)
    face = np.repeat(np.arange(len(counts)), n)
    first = np.repeat(np.cumsum(counts) - counts, n)
    step = np.arange(len(face)) - np.repeat(np.cumsum(n) - n, n)
    return face, np.stack([first, first + step + 1, first + step + 2], axis=1)
