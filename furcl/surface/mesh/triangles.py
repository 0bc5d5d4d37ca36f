"""Triangles of a mesh as flat arrays, checked once and never changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import MeshError
from furcl.surface.mesh.indexed import Indexed, indexed, real

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
        normal_faces: ArrayLike | None = None,
        place_faces: ArrayLike | None = None,
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
        normals : (k, 3) or None    any length
        places : (l, 2) or None     u, v
        normal_faces, place_faces : (n, 3) integers or None
                                    normal and place of each corner; None: those of its vertex
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
        given = {
            name: indexed(values, index, indices, points, f"{where}: {name}", width)
            for name, values, index, width in (
                ("normals", normals if smooth else None, normal_faces, 3),
                ("texture coordinates", places, place_faces, 2),
            )
        }
        identity = _positions(points)[indices]
        del points, indices
        has_area = _has_area(corners)
        if not has_area.any():
            raise MeshError(
                f"{where}: all {len(corners)} triangles have their corners on a line: there is "
                f"nothing to see; check the file, and the scale of its transform"
            )
        dropped = {"triangles without an area": int((~has_area).sum())}
        if not has_area.all():
            corners, identity = corners[has_area], identity[has_area]
            given = {name: values.of(has_area) for name, values in given.items()}
        for name, values in given.items():
            values.check(f"{where}: {name}")
        sign = 1.0
        if _is_closed(identity) and _volume(corners) < 0.0:
            dropped["triangles turned inside out"] = len(corners)
            sign = -1.0
            turned = np.s_[:, ::-1]
            corners, identity = np.ascontiguousarray(corners[turned]), identity[turned]
            given = {name: values.of(turned) for name, values in given.items()}
        of_corners, uv = given.values()
        return cls(
            corners,
            _corner_normals(of_corners, sign, corners, identity) if smooth else None,
            None if uv.values is None else uv.values.astype(np.float32, copy=False)[uv.index],
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
) -> tuple[NDArray[np.float32], NDArray[Any]]:
    """Positions of the vertices, and the vertices of the triangles."""
    points, indices = real(vertices), np.asarray(faces)
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
        return points.astype(np.float32, copy=False), indices


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


def _positions(points: NDArray[np.float32]) -> NDArray[np.int32]:
    """A number (m,) for each point, the same for points at the same place."""
    order = np.lexsort(points.T)
    differs = np.zeros(len(points), np.int32)
    for axis in range(3):
        along = points[order, axis]
        differs[1:] |= along[1:] != along[:-1]
    out = np.empty_like(differs)
    out[order] = np.cumsum(differs, out=differs)
    return out


def _is_closed(identity: NDArray[np.int32]) -> bool:
    n = int(identity.max()) + 1
    forth = _edges(identity, np.roll(identity, -1, axis=1), n)
    if (forth[1:] == forth[:-1]).any():
        return False
    return bool((forth == _edges(np.roll(identity, -1, axis=1), identity, n)).all())


def _edges(start: NDArray[np.int32], end: NDArray[np.int32], n: int) -> NDArray[np.int64]:
    """A number for each edge between two of n positions, sorted."""
    out = start.ravel().astype(np.int64)
    out *= n
    out += end.ravel()
    out.sort()
    return out


def _volume(corners: NDArray[np.float32]) -> float:
    centre = corners.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    volume = 0.0
    for block in _blocks(len(corners)):
        a, b, c = np.moveaxis(corners[block].astype(np.float64) - centre, 1, 0)
        volume += float((a * np.cross(b, c)).sum())
    return volume / 6.0


def _corner_normals(
    given: Indexed,
    sign: float,
    corners: NDArray[np.float32],
    identity: NDArray[np.int32],
) -> NDArray[np.float32]:
    """Those that are given times a sign; where they are none or have no length, smooth ones."""
    sums = _smooth_sums(corners, identity)
    out = np.empty_like(corners)
    for block in _blocks(len(corners)):
        faces = _unit(_crosses(corners[block]))[:, None]
        found = _unit_or(sums[identity[block]], faces)
        of_file = given.at(block)
        if of_file is not None:
            found = _unit_or(sign * of_file.astype(np.float64), found)
        out[block] = found
    return out


def _smooth_sums(corners: NDArray[np.float32], identity: NDArray[np.int32]) -> NDArray[np.float64]:
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
