"""Straight fibres for tests."""

from collections.abc import Sequence

import numpy as np

from furcl.groom.curves import Curves, adopted
from furcl.groom.grow.ranges import FIBRE_RANGES, check


def fibre(
    *,
    count: int = 1,
    length: float = 1.0,
    radius: float = 0.01,
    spacing: float = 0.1,
    axis: str = "x",
    centre: Sequence[float] = (0.0, 0.0, 0.0),
    n_points: int = 2,
) -> Curves:
    """A row of equal straight fibres that run along an axis.

    Parameters
    ----------
    count : int                  fibres, 1 .. 1e6
    length : float               of each, 1e-6 .. 1e6 [unit]
    radius : float               the same everywhere, 1e-9 .. 1e5 [unit]
    spacing : float              between neighbouring axes; the row extends along the next axis
                                 (x, y, z, x), 0 .. 1e6 [unit]
    axis : str                   "x", "y" or "z": root to tip runs towards +
    centre : (3,)                of the whole row, -1e6 .. 1e6 [unit]
    n_points : int               points a fibre, evenly spaced, 2 .. 4096

    Raises
    ------
    GroomError                   a parameter outside its range
    """
    check("fibre", FIBRE_RANGES, locals())
    along = "xyz".index(axis)
    points = np.tile(np.asarray(centre, dtype=np.float64), (count, n_points, 1))
    points[:, :, along] += length * np.linspace(-0.5, 0.5, n_points)
    points[:, :, (along + 1) % 3] += spacing * (np.arange(count) - (count - 1) / 2.0)[:, None]
    return adopted(points, radius, source="fibre")
