"""Triangles of a mesh as flat arrays, checked once and never changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import MeshError

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
        corners = points.astype(np.float32)[indices]
        has_area = _doubled_areas(corners) > 0.0
        if not has_area.any():
            raise MeshError(
                f"{where}: all {len(corners)} triangles have their corners on a line: there is "
                f"nothing to see; check the file, and the scale of its transform"
            )
        dropped = {"triangles without an area": int((~has_area).sum())}
        corners, indices = corners[has_area], indices[has_area]
        kept = (
            _at_corners(normals, indices, len(points), 3, f"{where}: normals") if smooth else None
        )
        uv = _at_corners(places, indices, len(points), 2, f"{where}: texture coordinates")
        identity = _positions(corners)
        if _is_closed(identity) and _volume(corners) < 0.0:
            dropped["triangles turned inside out"] = len(corners)
            corners, identity = corners[:, ::-1], identity[:, ::-1]
            kept = None if kept is None else -kept[:, ::-1]
            uv = None if uv is None else uv[:, ::-1]
        if smooth:
            kept = _unit_or(kept, _smooth_normals(corners, identity))
        return cls(
            np.ascontiguousarray(corners),
            None if kept is None else np.ascontiguousarray(kept, np.float32),
            None if uv is None else np.ascontiguousarray(uv, np.float32),
            {name: count for name, count in dropped.items() if count},
        )

    @property
    def is_closed(self) -> bool:
        """Whether every edge is shared by two triangles that run along it in opposite ways."""
        return _is_closed(_positions(self.corners))

    def bounds(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Lower and upper corner of the box around all triangles, (3,) each."""
        points = self.corners.reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)


def _checked(
    vertices: ArrayLike, faces: ArrayLike, where: str
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
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
    with np.errstate(invalid="ignore"):
        bad = used & ~(np.abs(points) <= MAX_MAGNITUDE).all(axis=1)
    if bad.any():
        vertex = int(np.flatnonzero(bad)[0])
        raise MeshError(
            f"{where}: vertex {vertex} is at {tuple(points[vertex].tolist())}; finite coordinates "
            f"up to {MAX_MAGNITUDE:g} are allowed; correct the file, or scale it by its transform"
        )
    return np.where(used[:, None], points, 0.0), indices.astype(np.int64)


def _at_corners(
    values: ArrayLike | None, indices: NDArray[np.int64], n: int, width: int, where: str
) -> NDArray[np.float64] | None:
    """Values of vertices at the corners of triangles."""
    if values is None:
        return None
    array = np.asarray(values, np.float64)
    if array.shape != (n, width):
        raise MeshError(f"{where} have the shape {array.shape}; expected {(n, width)}")
    found = array[indices]
    if not np.isfinite(found).all():
        vertex = int(indices[~np.isfinite(found).all(axis=2)][0])
        raise MeshError(
            f"{where}: that of vertex {vertex} is {array[vertex].tolist()}; correct the file"
        )
    return found


def _crosses(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    a, b, c = np.moveaxis(corners.astype(np.float64), 1, 0)
    return np.cross(b - a, c - a)


def _doubled_areas(corners: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.linalg.norm(_crosses(corners), axis=1)


def _positions(corners: NDArray[np.float32]) -> NDArray[np.int64]:
    """A number (n, 3) for each corner, the same for corners at the same place."""
    flat = np.ascontiguousarray(corners.reshape(-1, 3) + np.float32(0.0))  # -0 becomes 0
    keys = flat.view(np.dtype((np.void, flat.itemsize * 3))).ravel()
    return np.unique(keys, return_inverse=True)[1].reshape(-1, 3)


def _is_closed(identity: NDArray[np.int64]) -> bool:
    edges = np.stack([identity, np.roll(identity, -1, axis=1)], axis=2).reshape(-1, 2)
    n = identity.max() + 1
    forth, back = edges[:, 0] * n + edges[:, 1], edges[:, 1] * n + edges[:, 0]
    return bool((np.sort(forth) == np.sort(back)).all() and len(np.unique(forth)) == len(forth))


def _volume(corners: NDArray[np.float32]) -> float:
    centre = corners.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    a, b, c = np.moveaxis(corners.astype(np.float64) - centre, 1, 0)
    return float((a * np.cross(b, c)).sum() / 6.0)


def _smooth_normals(
    corners: NDArray[np.float32], identity: NDArray[np.int64]
) -> NDArray[np.float64]:
    faces = _unit(_crosses(corners))
    ways = np.roll(corners, -1, axis=1).astype(np.float64) - corners
    along = ways / np.maximum(np.linalg.norm(ways, axis=2, keepdims=True), 1e-300)
    cosines = -(along * np.roll(along, 1, axis=1)).sum(axis=2)
    angles = np.arccos(np.clip(cosines, -1.0, 1.0))
    sums = np.zeros((identity.max() + 1, 3))
    for corner in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(
                identity[:, corner], angles[:, corner] * faces[:, axis], len(sums)
            )
    return _unit_or(sums[identity], np.broadcast_to(faces[:, None], corners.shape))


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _unit_or(vectors: NDArray[np.float64] | None, instead: NDArray) -> NDArray[np.float64]:
    """Vectors at unit length; others in place of those that have none, or where there are none."""
    if vectors is None:
        return instead
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    has_length = lengths > 1e-12
    return np.where(has_length, vectors / np.where(has_length, lengths, 1.0), instead)
