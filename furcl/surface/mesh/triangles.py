"""Triangles of a mesh as flat arrays, checked once and never changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import MeshError

# Triangles that are worked on at a time: what that takes does not grow with the mesh.
BLOCK = 1 << 15
#: Largest coordinate: products of three of them stay within float32, as areas have to.
MAX_MAGNITUDE = 1e9


@dataclass(frozen=True, eq=False, repr=False)
class Triangles:
    """Triangles with a normal and a place in a texture for each corner, where there are any.

    Build them with :meth:`from_arrays`, which checks and cleans.

    Attributes
    ----------
    corners : (n, 3, 3) float32     positions [scene unit], seen from outside against the clock
    normals : (n, 3, 3) float32     unit vectors, or None: reflection is that of flat facets
    places : (n, 3, 2) float32      u, v in a texture, (0, 0) its lower left corner; or None
    dropped : mapping               what cleaning removed or changed: name -> count, only counts > 0
    """

    corners: NDArray[np.float32]
    normals: NDArray[np.float32] | None = None
    places: NDArray[np.float32] | None = None
    dropped: Mapping[str, int] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Triangles({len(self)})"

    def __len__(self) -> int:
        return len(self.corners)

    @classmethod
    def from_arrays(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        normals: ArrayLike | None = None,
        places: ArrayLike | None = None,
        smooth: bool = True,
        where: str = "mesh",
    ) -> Triangles:
        """Check and clean a mesh.

        Triangles without an area are left out. A closed mesh that is inside out is turned, so that
        its fronts are outside.

        Parameters
        ----------
        vertices : (m, 3)           positions [scene unit]
        faces : (n, 3) integers     vertices of each triangle
        normals : (m, 3) or None    of the vertices, any length
        places : (m, 2) or None     u, v of the vertices
        smooth : bool               keep the normals; where there are none, make them: the mean of
                                    those of the triangles around a position, weighed by their
                                    angles (Thuermer and Wuethrich 1998). False: flat facets
        where : str                 the mesh, for messages

        Raises
        ------
        MeshError       no triangles, none with an area, wrong shapes, indices outside the vertices,
                        values that are not finite or too large
        """
        points, indices = _checked(vertices, faces, where)
        corners = points[indices]
        has_area = _has_area(corners)
        if not has_area.any():
            raise MeshError(
                f"{where}: all {len(corners)} triangles have their corners on a line: there is "
                f"nothing to see; check the file, and the scale of its transform"
            )
        dropped = {"triangles without an area": int((~has_area).sum())}
        if not has_area.all():
            corners, indices = corners[has_area], indices[has_area]
        of_vertices = _of_vertices(
            normals if smooth else None, indices, points, f"{where}: normals"
        )
        uv = _of_vertices(places, indices, points, f"{where}: texture coordinates", 2)
        identity = _positions(points)[indices]
        sign = 1.0
        if _is_closed(identity) and _volume(corners) < 0.0:
            dropped["triangles turned inside out"] = len(corners)
            sign = -1.0
            corners = np.ascontiguousarray(corners[:, ::-1])
            indices, identity = indices[:, ::-1], identity[:, ::-1]
        return cls(
            corners,
            _corner_normals(of_vertices, sign, indices, corners, identity) if smooth else None,
            None if uv is None else uv.astype(np.float32)[indices],
            {name: count for name, count in dropped.items() if count},
        )

    @property
    def is_closed(self) -> bool:
        """Whether every edge is shared by two triangles that run along it in opposite ways."""
        return _is_closed(_positions(self.corners.reshape(-1, 3)).reshape(-1, 3))

    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Lower and upper corner of the box around all triangles, (3,) each."""
        points = self.corners.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)


def _checked(
    vertices: ArrayLike, faces: ArrayLike, where: str
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Positions of the vertices, and the vertices of the triangles."""
    points, indices = np.asarray(vertices, np.float64), np.asarray(faces)
    if indices.size == 0 or points.size == 0:
        raise MeshError(
            f"{where}: has no triangles ({len(points)} vertices); give a file with faces"
        )
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{where}: vertices have the shape {points.shape}; expected (m, 3)")
    if indices.ndim != 2 or indices.shape[1] != 3 or indices.dtype.kind not in "iu":
        raise MeshError(
            f"{where}: faces are {indices.dtype} of the shape {indices.shape}; expected whole "
            f"numbers (n, 3)"
        )
    outside = (indices < 0) | (indices >= len(points))
    if outside.any():
        face = int(np.flatnonzero(outside.any(axis=1))[0])
        raise MeshError(
            f"{where}: triangle {face} has the vertices {indices[face].tolist()}; allowed are 0 to "
            f"{len(points) - 1}; the file is damaged"
        )
    used = np.zeros(len(points), bool)
    used[indices] = True
    bad = used & ~((points <= MAX_MAGNITUDE) & (points >= -MAX_MAGNITUDE)).all(axis=1)
    if bad.any():
        vertex = int(np.flatnonzero(bad)[0])
        raise MeshError(
            f"{where}: vertex {vertex} is at {tuple(points[vertex].tolist())}; finite coordinates "
            f"up to {MAX_MAGNITUDE:g} are allowed; correct the file, or scale it by its transform"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # of vertices that are not used
        return points.astype(np.float32), indices.astype(np.int64, copy=False)


def _of_vertices(
    values: ArrayLike | None,
    indices: NDArray[np.int64],
    points: NDArray[np.float32],
    where: str,
    width: int = 3,
) -> NDArray[np.float64] | None:
    """Values of vertices, finite where a triangle uses them."""
    if values is None:
        return None
    array = np.asarray(values, np.float64)
    if array.shape != (len(points), width):
        raise MeshError(f"{where} have the shape {array.shape}; expected {(len(points), width)}")
    used = np.zeros(len(points), bool)
    used[indices] = True
    bad = used & ~np.isfinite(array).all(axis=1)
    if bad.any():
        vertex = int(np.flatnonzero(bad)[0])
        raise MeshError(
            f"{where}: that of vertex {vertex} is {array[vertex].tolist()}; correct the file"
        )
    return array


def _blocks(n: int) -> Iterator[slice]:
    for start in range(0, n, BLOCK):
        yield slice(start, start + BLOCK)


def _crosses(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


def _has_area(corners: NDArray[np.float32]) -> NDArray[np.bool_]:
    out = np.empty(len(corners), bool)
    for block in _blocks(len(corners)):
        out[block] = np.linalg.norm(_crosses(corners[block]), axis=1) > 0.0
    return out


def _positions(points: NDArray[np.float32]) -> NDArray[np.int64]:
    """A number (m,) for each point, the same for points at the same place."""
    order = np.lexsort(points.T)
    differs = np.zeros(len(points), np.int64)
    for axis in range(3):
        along = points[order, axis]
        differs[1:] |= along[1:] != along[:-1]
    out = np.empty_like(order)
    out[order] = np.cumsum(differs, out=differs)
    return out


def _is_closed(identity: NDArray[np.int64]) -> bool:
    n = identity.max() + 1
    forth = (identity * n + np.roll(identity, -1, axis=1)).ravel()
    forth.sort()
    if (forth[1:] == forth[:-1]).any():
        return False
    back = (np.roll(identity, -1, axis=1) * n + identity).ravel()
    back.sort()
    return bool((forth == back).all())


def _volume(corners: NDArray[np.float32]) -> float:
    centre = corners.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    volume = 0.0
    for block in _blocks(len(corners)):
        a, b, c = np.moveaxis(corners[block].astype(np.float64) - centre, 1, 0)
        volume += float((a * np.cross(b, c)).sum())
    return volume / 6.0


def _corner_normals(
    of_vertices: NDArray[np.float64] | None,
    sign: float,
    indices: NDArray[np.int64],
    corners: NDArray[np.float32],
    identity: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Those of the vertices times a sign; where they are none or have no length, smooth ones."""
    sums = _smooth_sums(corners, identity)
    out = np.empty_like(corners)
    for block in _blocks(len(corners)):
        faces = _unit(_crosses(corners[block]))[:, None]
        found = _unit_or(sums[identity[block]], faces)
        if of_vertices is not None:
            found = _unit_or(sign * of_vertices[indices[block]], found)
        out[block] = found
    return out


def _smooth_sums(corners: NDArray[np.float32], identity: NDArray[np.int64]) -> NDArray[np.float64]:
    """Normals of the triangles around each position, weighed by their angles."""
    sums = np.zeros((identity.max() + 1, 3))
    for block in _blocks(len(corners)):
        faces, ids = _unit(_crosses(corners[block])), identity[block]
        ways = np.roll(corners[block], -1, axis=1).astype(np.float64) - corners[block]
        along = ways / np.maximum(np.linalg.norm(ways, axis=2, keepdims=True), 1e-300)
        cosines = -(along * np.roll(along, 1, axis=1)).sum(axis=2)
        angles = np.arccos(np.clip(cosines, -1.0, 1.0))
        for corner in range(3):
            np.add.at(sums, ids[:, corner], angles[:, corner, None] * faces)
    return sums


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _unit_or(vectors: NDArray[np.float64], instead: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors at unit length; others in place of those that have none."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    has_length = lengths > 1e-12
    return np.where(has_length, vectors / np.where(has_length, lengths, 1.0), instead)
