"""Values that the corners of triangles share by an index, such as normals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import MeshError


@dataclass(frozen=True, eq=False)
class Indexed:
    """Values (k, width), and which of them each corner (n, 3) has; None where there are none."""

    values: NDArray[Any] | None
    index: NDArray[Any]

    def of(self, some: Any) -> Indexed:
        """Those of some triangles, or of corners in another order."""
        return self if self.values is None else Indexed(self.values, self.index[some])

    def at(self, some: slice) -> NDArray[Any] | None:
        """Values (n, 3, width) of the corners of some triangles."""
        return None if self.values is None else self.values[self.index[some]]

    def check(self, where: str) -> None:
        """Refuse what is not finite at a corner.

        Raises
        ------
        MeshError       the first of them
        """
        if self.values is None:
            return
        used = np.zeros(len(self.values), bool)
        used[self.index] = True
        bad = used & ~np.isfinite(self.values).all(axis=1)
        if bad.any():
            at = int(np.flatnonzero(bad)[0])
            raise MeshError(f"{where}: number {at} is {self.values[at].tolist()}; correct the file")


def indexed(
    values: ArrayLike | None,
    index: ArrayLike | None,
    of_vertices: NDArray[Any],
    points: NDArray[np.float32],
    where: str,
    width: int = 3,
) -> Indexed:
    """Values of corners; without an index, those of their vertices.

    Raises
    ------
    MeshError       wrong shapes, indices of values that are not there
    """
    if values is None:
        return Indexed(None, of_vertices)
    array = real(values)
    n = len(points) if index is None else len(array)
    if array.shape != (n, width):
        raise MeshError(f"{where} have the shape {array.shape}; expected {(n, width)}")
    if index is None:
        return Indexed(array, of_vertices)
    given = np.asarray(index)
    if given.shape != of_vertices.shape or given.dtype.kind not in "iu":
        raise MeshError(
            f"{where}: their faces are {given.dtype} of the shape {given.shape}; expected whole "
            f"numbers {of_vertices.shape}"
        )
    if given.min() < 0 or given.max() >= n:
        raise MeshError(f"{where}: their faces go from {given.min()} to {given.max()}, of {n}")
    return Indexed(array, given)


def real(values: ArrayLike) -> NDArray[Any]:
    """As float32 if it is that, else as float64."""
    array = np.asarray(values)
    return array if array.dtype == np.float32 else array.astype(np.float64, copy=False)
