"""Mesh files: Wavefront OBJ and Stanford PLY."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import MeshError
from furcl.files import check_regular, named
from furcl.memory import require_memory
from furcl.ply import read_header
from furcl.surface.mesh.obj import read_obj
from furcl.surface.mesh.ply import read_binary_ply
from furcl.surface.mesh.ply_text import read_text_ply

# Bytes that a mesh takes for each triangle at most, until it is one of furcl.
TRIANGLE_PEAK = 288


@dataclass(frozen=True, eq=False)
class MeshArrays:
    """A mesh as its file has it; polygons are cut into triangles.

    Attributes
    ----------
    vertices : (m, 3) float64 or float32    in the units and the axes of the file
    faces : (n, 3) int32                    vertices of each triangle
    normals : (k, 3) float32 or None
    normal_faces : (n, 3) int32 or None     normal of each corner; None: that of its vertex
    places : (l, 2) float32 or None         u, v
    place_faces : (n, 3) int32 or None      place of each corner; None: that of its vertex
    """

    vertices: NDArray[Any]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32] | None = None
    normal_faces: NDArray[np.int32] | None = None
    places: NDArray[np.float32] | None = None
    place_faces: NDArray[np.int32] | None = None


def read_mesh(path: str | os.PathLike[str]) -> MeshArrays:
    """Read all objects of a mesh file as one mesh.

    Materials, colours and groups of the file are not used. Normals and texture coordinates are read
    where all corners have them.

    Raises
    ------
    MeshError       no such file, another format, a damaged file or one without triangles
    """
    path = named(path, MeshError)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise MeshError(
            f"{path}: meshes are read from {', '.join(READERS)} and USD files; convert it, for "
            f"example with Blender"
        )

    def check_size(n_triangles: int) -> None:
        require_memory(path, TRIANGLE_PEAK * n_triangles, MeshError)

    try:
        check_regular(path)
        with np.errstate(all="ignore"):  # numpy would print what damage does to sums
            found = reader(path, check_size)
            if len(found.get("faces", ())):
                return MeshArrays(**found)
    except (MemoryError, MeshError):
        raise
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror}; give a mesh") from None
    except Exception as error:  # whatever a damaged file makes of it
        raise MeshError(
            f"{path}: is no {path.suffix.lower()} file that can be read: {error!s:.300}; export it "
            f"again"
        ) from None
    raise MeshError(f"{path}: has no triangles; give a file with faces")


def _read_ply(path: Path, check_size: Callable[[int], None]) -> dict[str, Any]:
    header = read_header(path, MeshError)
    return (read_text_ply if header.is_text else read_binary_ply)(path, header, check_size)


READERS: dict[str, Callable[[Path, Callable[[int], None]], dict[str, Any]]] = {
    ".obj": read_obj,
    ".ply": _read_ply,
}
