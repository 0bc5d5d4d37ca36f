"""Where a groom, a mesh or a lamp stands in the scene: scaled, turned, moved."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from furcl.table import Coordinate, Table, Vec3

Array = NDArray[np.float64]
Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]
Row = tuple[Coordinate, Coordinate, Coordinate, Coordinate]

# Of the lengths of a matrix's columns: what differs by less is the same factor.
_SAME_SCALE = 1e-5


class Transform(Table, frozen=True, kw_only=True):
    """A place in the scene: `scale`, then `rotate_deg`, then `translate`; or a `matrix`.

    Attributes
    ----------
    scale : float or (x, y, z)      factor on lengths, such as a file's unit in the
                                    scene's; not 0
    rotate_deg : (x, y, z)          about the x axis, then the y axis, then the z axis [deg]
    translate : (x, y, z)           how far it is moved, last of all [unit]
    matrix : 4 rows of 4            of column vectors, the last row 0 0 0 1; instead of the others
    """

    allowed: ClassVar = {"scale": (-1e9, 1e9)}

    scale: float | tuple[float, float, float] = 1.0
    rotate_deg: tuple[Degrees, Degrees, Degrees] = (0.0, 0.0, 0.0)
    translate: Vec3 = (0.0, 0.0, 0.0)
    matrix: tuple[Row, Row, Row, Row] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.matrix is not None:
            others = [name for name, default in _DEFAULTS.items() if getattr(self, name) != default]
            if others:
                raise ValueError(f"matrix is given beside {', '.join(others)}; give one of them")
            if tuple(self.matrix[3]) != (0.0, 0.0, 0.0, 1.0):
                raise ValueError(f"matrix: its last row is {self.matrix[3]}; it must be 0, 0, 0, 1")
        linear = self.as_matrix()[:3, :3]
        if not abs(np.linalg.det(linear / max(np.abs(linear).max(), 1e-300))) > 1e-12:
            name = "scale" if self.matrix is None else "matrix"
            raise ValueError(
                f"{name} = {getattr(self, name)}: it flattens what it is applied to; no scale may "
                f"be 0"
            )

    def as_matrix(self) -> Array:
        """The matrix (4, 4) of column vectors."""
        if self.matrix is not None:
            return np.array(self.matrix, np.float64)
        x, y, z = (math.radians(angle) for angle in self.rotate_deg)
        about_x = _turn(x, 1, 2)
        about_y = _turn(y, 2, 0)
        about_z = _turn(z, 0, 1)
        out = np.eye(4)
        out[:3, :3] = about_z @ about_y @ about_x @ np.diag(np.broadcast_to(self.scale, 3))
        out[:3, 3] = self.translate
        return out

    @property
    def is_identity(self) -> bool:
        """Whether it changes nothing."""
        return bool((self.as_matrix() == np.eye(4)).all())

    def points(self, points: ArrayLike) -> Array:
        """Points (..., 3) in the scene."""
        return moved(points, self.as_matrix())

    def vectors(self, vectors: ArrayLike) -> Array:
        """Directions (..., 3) in the scene, as long as the scale makes them."""
        return np.asarray(vectors, np.float64) @ self.as_matrix()[:3, :3].T

    def normals(self, normals: ArrayLike) -> Array:
        """Unit normals (..., 3) in the scene, by the inverse transpose; a mirror keeps them
        outside."""
        turned = np.asarray(normals, np.float64) @ np.linalg.inv(self.as_matrix()[:3, :3])
        return turned / np.linalg.norm(turned, axis=-1, keepdims=True)

    def uniform_scale(self) -> float:
        """The factor on radii.

        Raises
        ------
        ValueError      if lengths along different axes take different factors
        """
        lengths = np.linalg.norm(self.as_matrix()[:3, :3], axis=0)
        gram = self.as_matrix()[:3, :3].T @ self.as_matrix()[:3, :3]
        size = float(lengths.mean())
        if np.abs(gram - size * size * np.eye(3)).max() > _SAME_SCALE * size * size:
            raise ValueError(
                f"scales by {', '.join(f'{x:g}' for x in lengths)} along x, y, z or shears; radii "
                f"need one scale for all"
            )
        return size


def moved(points: ArrayLike, matrix: Array) -> Array:
    """Points (..., 3) where a matrix (4, 4) takes them."""
    return np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _turn(angle: float, first: int, second: int) -> Array:
    """The rotation by an angle [rad] that takes axis `first` towards axis `second`."""
    out = np.eye(3)
    out[first, first] = out[second, second] = math.cos(angle)
    out[second, first] = math.sin(angle)
    out[first, second] = -math.sin(angle)
    return out


_DEFAULTS = {"scale": 1.0, "rotate_deg": (0.0, 0.0, 0.0), "translate": (0.0, 0.0, 0.0)}
