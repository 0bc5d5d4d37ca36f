"""Mesh files: Wavefront OBJ and Stanford PLY, read by trimesh."""

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

Array = NDArray[np.float64]

# Bytes that reading takes for each of a file's, of 10^5 and more.
PEAK, ASCII_PLY_PEAK = 10, 20


@dataclass(frozen=True, eq=False)
class MeshArrays:
    """A mesh as its file has it; polygons are cut into triangles.

    Attributes
    ----------
    vertices : (m, 3) float64       in the units and the axes of the file
    faces : (n, 3) int64
    normals : (m, 3) or None        of the vertices
    places : (m, 2) or None         u, v of the vertices
    """

    vertices: Array
    faces: NDArray[np.int64]
    normals: Array | None
    places: Array | None


def read_mesh(path: str | os.PathLike[str]) -> MeshArrays:
    """Read all objects of a mesh file as one mesh.

    Materials, colours and groups of the file are not used. Normals and texture coordinates are read
    where all objects have them.

    Raises
    ------
    MeshError       no such file, another format, a file that trimesh refuses or without triangles
    """
    path = named(path, MeshError)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise MeshError(
            f"{path}: meshes are read from {', '.join(READERS)} and USD files; convert it, for "
            f"example with Blender or trimesh"
        )
    try:
        check_regular(path)
        require_memory(path, peak_bytes(path), MeshError)
        with np.errstate(all="ignore"):  # numpy would print what damage does to trimesh's sums
            objects = reader(path)
            objects = [o for o in objects if len(o.get("faces", ())) and len(o.get("vertices", ()))]
            if objects:
                return _joined(objects)
    except (MemoryError, MeshError):
        raise
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror}; give a mesh") from None
    except Exception as error:  # whatever a damaged file makes of trimesh
        raise MeshError(
            f"{path}: is no {path.suffix.lower()} file that trimesh reads: {error!s:.200}; export "
            f"it again"
        ) from None
    raise MeshError(f"{path}: has no triangles; give a file with faces")


def peak_bytes(path: Path) -> int:
    """What reading a mesh file takes at most, with the checks of Triangles.from_arrays [bytes]."""
    with path.open("rb") as file:
        head = file.read(64)
    is_text = head.startswith(b"ply") and b"ascii" in head
    return path.stat().st_size * (ASCII_PLY_PEAK if is_text else PEAK)


def _read_obj(path: Path) -> list[dict[str, Any]]:
    from trimesh.exchange.obj import load_obj

    with path.open(encoding="utf-8", errors="replace") as file:
        found = load_obj(file, skip_materials=True)
    return list(found["geometry"].values()) if "geometry" in found else [found]


def _read_ply(path: Path) -> list[dict[str, Any]]:
    from trimesh.exchange.ply import load_ply

    with path.open("rb") as file:
        return [load_ply(file, skip_materials=True)]


READERS: dict[str, Callable[[Path], list[dict[str, Any]]]] = {".obj": _read_obj, ".ply": _read_ply}


def _joined(objects: list[dict[str, Any]]) -> MeshArrays:
    from trimesh.geometry import triangulate_quads

    faces, first = [], 0
    for each in objects:
        faces.append(np.asarray(triangulate_quads(each["faces"]), np.int64) + first)
        first += len(each["vertices"])
    uv = [getattr(each.get("visual"), "uv", None) for each in objects]
    vertices = np.concatenate([_columns(each["vertices"], 3, "vertices") for each in objects])
    return MeshArrays(
        vertices,
        np.concatenate(faces),
        _all_or_none([each.get("vertex_normals") for each in objects], 3, "normals"),
        _all_or_none(uv, 2, "texture coordinates"),
    )


def _all_or_none(arrays: list[Any], width: int, what: str) -> Array | None:
    if any(array is None for array in arrays):
        return None
    return np.concatenate([_columns(array, width, what) for array in arrays])


def _columns(array: Any, width: int, what: str) -> Array:
    found = np.asarray(array, np.float64)
    if found.ndim != 2 or found.shape[1] != width:
        raise ValueError(f"{what} have the shape {found.shape}, expected is (m, {width})")
    return found
