"""Stanford PLY files: what their elements mean, and the binary ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.ply import Header
from furcl.surface.mesh.text import fans

#: Lists of the vertices of polygons; of the texture coordinates of their corners.
INDICES, OF_CORNERS = ("vertex_indices", "vertex_index"), "texcoord"
#: Texture coordinates of the vertices, as exporters call them.
PLACES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
AXES = ("x", "y", "z")
Lists = Mapping[str, tuple[NDArray[Any], NDArray[np.int64]]]


def read_binary_ply(
    path: Path, header: Header, check_size: Callable[[int], None]
) -> dict[str, Any]:
    """The polygons of a file, as triangles, by plyfile, which maps the file into memory.

    Parameters
    ----------
    check_size : function       of the triangles, called before they are made

    Returns
    -------
    dict            of fields of furcl.surface.mesh.read.MeshArrays

    Raises
    ------
    ValueError      the file is damaged, or its polygons have not all three, or all four, corners
    """
    names = [
        name
        for e in header.elements
        if e.name == "face"
        for name, is_list in e.properties
        if is_list
    ]
    if not names or not any(e.name == "vertex" for e in header.elements):
        return {}
    elements, n_corners = _mapped(path, names)
    faces, vertices = elements["face"], elements["vertex"]
    check_size(len(faces) * (n_corners - 2))
    lists = {}
    for name in names:
        rows = faces[name]
        lists[name] = rows.reshape(-1), np.full(len(rows), rows.shape[1])
    columns = {name: vertices[name] for name in vertices.dtype.names or ()}
    return joined(of_vertices(columns) | of_faces(lists)) if len(faces) else {}


def _mapped(path: Path, names: list[str]) -> tuple[dict[str, Any], int]:
    """Tables of the elements, and the corners of each face."""
    from plyfile import PlyData, PlyElementParseError

    damage = None
    for n_corners in (3, 4):
        lengths = {name: 2 * n_corners if name == OF_CORNERS else n_corners for name in names}
        try:
            data = PlyData.read(str(path), known_list_len={"face": lengths})
        except PlyElementParseError as error:
            damage = error
        else:
            return {element.name: element.data for element in data.elements}, n_corners
    raise ValueError(
        f"{damage}; its faces have not all three or all four corners, or it is cut off: cut them "
        f"into triangles"
    )


def of_vertices(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Positions, normals and texture coordinates of vertices, of the columns of their element.

    Raises
    ------
    ValueError      they have no x, y and z
    """
    if not columns.keys() >= set(AXES):
        raise ValueError("its vertices have no x, y and z")
    wanted: dict[str, tuple[str, ...]] = {"vertices": AXES, "normals": ("nx", "ny", "nz")}
    for names in PLACES:
        if columns.keys() >= set(names):
            wanted["places"] = names
    found = {}
    for name, of_axes in wanted.items():
        if columns.keys() >= set(of_axes):
            given = [columns[axis] for axis in of_axes]
            exact = name == "vertices" and any(column.dtype.itemsize > 4 for column in given)
            dtype = np.float64 if exact else np.float32
            found[name] = np.stack([column.astype(dtype) for column in given], axis=1)
    return found


def of_faces(lists: Lists) -> dict[str, NDArray[Any]]:
    """Triangles, and texture coordinates of their corners where all have them, of the lists of an
    element of faces.

    Raises
    ------
    ValueError      indices that are not whole, faces of less than three corners
    """
    name = next((n for n in INDICES if n in lists), next(iter(lists)))
    corners, counts = lists[name]
    if counts.min() < 3:
        raise ValueError("a face has three corners or more")
    index = whole_numbers(corners)
    places, of_each = lists.get(OF_CORNERS, (None, counts))
    if places is not None and (of_each == 2 * counts).all():
        places = places.reshape(-1, 2).astype(np.float32)
    else:
        places = None
    if counts.max() > 3:
        cut = fans(counts)
        index, places = index[cut], None if places is None else places[cut.ravel()]
    found = {"faces": index.reshape(-1, 3)}
    return found if places is None else found | {"corner places": places}


def joined(found: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Fields of furcl.surface.mesh.read.MeshArrays, of those of `of_vertices` and `of_faces`."""
    if not found.keys() >= {"vertices", "faces"}:
        return {}
    places = found.pop("corner places", None)
    if places is None or len(places) != found["faces"].size:
        return found
    of_corners = np.arange(len(places), dtype=np.int32).reshape(-1, 3)
    return found | {"places": places, "place_faces": of_corners}


def whole_numbers(values: NDArray[Any]) -> NDArray[np.int32]:
    """A copy as int32.

    Raises
    ------
    ValueError      a value that is none
    """
    limit = np.iinfo(np.int32)
    right = (values >= limit.min) & (values <= limit.max)
    if values.dtype.kind == "f":
        right &= values == np.floor(values)
    if not right.all():
        raise ValueError("an index that is no whole number, or too large")
    return values.astype(np.int32)
