"""How hair leaves the scalp: hairline, combing, and growth under gravity."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.groom.grow import strands
from furcl.groom.grow.roots import Rng, Vectors, thinned, unit_directions
from furcl.groom.grow.strands import Block, Ellipsoid, dot, normalised

FEATHER_DEG = 3.0


@dataclass(frozen=True)
class Combing:
    """The part of the parameters of `hair` that shapes a strand before locks and waves."""

    lift: float  # rad
    parting: float
    parting_x: float
    comb_back: float
    gravity: float  # rad / unit
    volume: float  # unit


def scalp_roots(n: int, solid: Ellipsoid, hairline_deg, rng: Rng) -> Block:
    """Roots (n, 3), even over the area of the ellipsoid above the hairline.

    The hairline is an elevation angle that varies with the azimuth a from the face as
    m + p cos(a) + q cos(2 a), through the three angles hairline_deg = (front, side, back); hair
    thins out over three degrees on both sides of it.
    """
    front, side, back = hairline_deg
    p, q = (front - back) / 2.0, ((front + back) / 2.0 - side) / 2.0
    axes = solid.radii.ravel().astype(np.float64)

    def hairline(cos_a: Vectors) -> Vectors:
        return side + q + p * cos_a + q * (2.0 * cos_a**2 - 1.0)

    lowest = float(hairline(np.linspace(-1.0, 1.0, 201)).min()) - FEATHER_DEG
    cap = (0.5 - 0.5 * np.sin(np.radians(max(lowest, -90.0))), 1.0)

    def density(square: Vectors) -> Vectors:
        d = unit_directions(square * cap)
        cos_a = -d[:, 1] / np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-9)
        elevation = np.degrees(np.arcsin(np.clip(d[:, 2], -1.0, 1.0)))
        edge = np.clip((elevation - hairline(cos_a)) / (2.0 * FEATHER_DEG) + 0.5, 0.0, 1.0)
        # The area of the ellipsoid that belongs to a solid angle of the sphere.
        area = np.linalg.norm(d / axes, axis=1) * axes.min()
        return area * edge

    directions = strands.float32(unit_directions(thinned(n, density, rng) * cap))
    return solid.centre.T + directions * solid.radii.T


def root_directions(roots: Block, solid: Ellipsoid, combing: Combing) -> Block:
    """Unit directions (3, n) in which strands leave their roots (3, n)."""
    normal = solid.normal(roots)
    x, y, _ = (roots - solid.centre) / solid.radii
    wish = np.empty_like(roots)
    # Away from the parting, which ends behind the crown, backwards, and a little down.
    parting = combing.parting * np.clip(0.8 - 2.0 * y, 0.0, 1.0)
    wish[0] = parting * np.tanh((x - combing.parting_x) / 0.07)
    wish[1] = combing.comb_back
    wish[2] = -0.35
    along = wish - dot(wish, normal) * normal
    # Where the combing vanishes (a whorl), strands stand up instead of turning abruptly.
    along /= np.sqrt(dot(along, along)) + np.float32(0.05)
    lift = combing.lift
    return normalised(np.float32(np.sin(lift)) * normal + np.float32(np.cos(lift)) * along)


def lock_features(roots: Block, solid: Ellipsoid, combing: Combing) -> NDArray:
    """(n, 6) numbers that are near for strands of a lock: place, and direction of growth.

    The direction keeps strands on both sides of a parting apart.
    """
    size = np.cbrt(np.prod(solid.radii))
    return np.concatenate([roots / size, 0.5 * root_directions(roots.T, solid, combing).T], axis=1)


def grow(roots: Block, length: Block, n_points: int, solid, combing: Combing, rng: Rng) -> Block:
    """Strands (k, 3, b) from roots (3, b): combed, turned down by gravity, lying on the scalp.

    Each strand has its own height above the scalp, where it slides: roots higher up lie on top.
    """
    n = roots.shape[1]
    jitter = 0.12 * rng.standard_normal((3, n), dtype=np.float32)
    direction = normalised(root_directions(roots, solid, combing) + jitter)
    crown = 0.5 + 0.5 * (roots[2] - solid.centre[2]) / solid.radii[2]
    layer = 0.15 + 0.5 * crown + 0.35 * rng.random(n, dtype=np.float32)
    layer = np.float32(combing.volume / solid.radii.min()) * layer
    step = length / np.float32(n_points - 1)
    turn = np.float32(combing.gravity) * step

    block = np.empty((n_points, 3, n), dtype=np.float32)
    block[0] = roots
    for j in range(1, n_points):
        # The component of -z across the strand turns it; an upright strand falls over as fast as
        # a level one.
        down = direction[2] * direction
        down[2] -= 1.0
        down = np.where(direction[2] > 0.0, normalised(down), down)
        direction = normalised(direction + turn * down)
        height = 1.0 + layer * np.minimum(1.0, step * np.float32(4.0 * j))
        free = block[j - 1] + step * direction
        block[j] = solid.lift(free, height)
        # A strand that was lifted goes on along the scalp.
        normal = solid.normal(block[j])
        inward = np.where(solid.level(free) < height, np.minimum(dot(direction, normal), 0.0), 0.0)
        direction = normalised(direction - inward * normal)
    return block
