"""Roots of children on a mesh, where guides are near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from furcl.errors import GroomError

Points = NDArray[np.float64]

#: Roots are on the part of a mesh so near to a guide's root, of the guides' median distance to the
#: guide next to them.
REACH = 2.0
_DRAWN_AT_ONCE = 1 << 18


def usual_reach(roots: Points) -> float:
    """How far from roots (m, 3) of guides those of children are if nothing is said [unit].

    0 of a single guide, or where most guides share their roots.
    """
    if len(roots) < 2:
        return 0.0
    return REACH * float(np.median(KDTree(roots).query(roots, k=2)[0][:, 1]))


def roots_near(
    triangles: Points, guides: Points, n: int, reach: float, rng: np.random.Generator, source: str
) -> Points:
    """Roots (n, 3) on triangles (t, 3, 3), uniform by area where a guide's root is within `reach`.

    Parameters
    ----------
    guides : (m, 3)     roots of guides, a little above or below the mesh
    reach : float       above 0 [unit]
    source : str        the mesh, for messages

    Raises
    ------
    GroomError          no guide is near the mesh
    """
    tree = KDTree(guides)
    # Triangles of which some point may be within reach.
    middle = triangles.mean(axis=1)
    size = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    distance = tree.query(middle)[0]
    near = triangles[distance <= reach + size]
    a, b, c = np.moveaxis(near, 1, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    found: list[Points] = []
    missing, drawn, kept = n, 0, 0
    while missing > 0 and areas.sum() > 0.0:
        count = min(2 * missing + 64, _DRAWN_AT_ONCE)
        which = rng.choice(len(near), count, p=areas / areas.sum())
        root, along = np.sqrt(rng.random(count)), rng.random(count)
        v, w = (root * (1.0 - along))[:, None], (root * along)[:, None]
        points = a[which] + v * (b - a)[which] + w * (c - a)[which]
        points = points[tree.query(points, distance_upper_bound=reach)[0] <= reach][:missing]
        found.append(points)
        missing -= len(points)
        drawn, kept = drawn + count, kept + len(points)
        if drawn > 100 * _DRAWN_AT_ONCE and kept < 1e-4 * drawn:
            break
    if missing:
        raise GroomError(
            f"{source}: next to nothing of it is within {reach:.4g} of the guides' roots; the "
            f"nearest triangle's middle is {distance.min():.4g} away. Guides and mesh must be in "
            f"one space and unit; check that, or give a larger root_reach"
        )
    return np.concatenate(found)
