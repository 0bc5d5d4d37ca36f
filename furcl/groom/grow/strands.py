"""Shapes of strands, a block of them at a time.

A block of b strands of k points is (k, 3, b) float32: the strands lie side by side in memory, so
that each step is a few vector operations on data that stays in the cache.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK_STRANDS = 8192

Block = NDArray[np.floating[Any]]  # float32, as are all blocks


def float32(values: Any) -> Block:
    """Values as a float32 array, without a copy where they are one already."""
    return np.asarray(values, dtype=np.float32)


def normalised(vectors: Block) -> Block:
    """Vectors (3, b) divided by their lengths; zero stays zero."""
    length = np.sqrt(dot(vectors, vectors))
    return vectors / np.maximum(length, np.float32(1e-20))


def dot(a: Block, b: Block) -> Block:
    """Inner products (b,) of vectors (3, b)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@dataclass(frozen=True)
class Ellipsoid:
    """A solid that strands stay out of."""

    centre: Block  # (3, 1)
    radii: Block  # (3, 1)

    def level(self, points: Block) -> Block:
        """1 on the surface, less inside: distance from the centre in units of the radius."""
        q = (points - self.centre) / self.radii
        return np.sqrt(dot(q, q))

    def normal(self, points: Block) -> Block:
        """Outward unit normals (3, b) of the level surfaces through points."""
        return normalised((points - self.centre) / (self.radii * self.radii))

    def lift(self, points: Block, least: Block) -> Block:
        """Move points (3, b) of a level below `least` outwards to that level."""
        scale = np.maximum(least / np.maximum(self.level(points), np.float32(1e-6)), 1.0)
        return self.centre + (points - self.centre) * scale

    def margin(self, step: Block) -> Block:
        """The least level of a point after the root so that segments of length `step` stay out.

        |q|^2 along a chord of length l from level 1 to level 1 + m is at least
        1 + 2 t m - t (1 - t) l^2, hence m >= l^2 / 2; half as much again is added to l because
        waves stretch segments. The cap holds the shape where segments are too long for this.
        """
        chord = 1.5 * step / np.min(self.radii)
        return np.minimum(1.003 + 0.5 * chord * chord, np.float32(1.1))


@dataclass(frozen=True)
class HalfSpace:
    """Everything below the plane z = height."""

    height: np.float32

    def lift(self, points: Block, least: Block) -> Block:
        """Move points of a height below `least` (over the plane) up to it."""
        points[2] = np.maximum(points[2], self.height + least)
        return points

    def margin(self, step: Block) -> Block:
        """A little above the plane, so that strands do not lie in it."""
        return np.float32(0.01) * step


def keep_out(block: Block, solid: Ellipsoid | HalfSpace, step: Block) -> None:
    """Lift all points but the roots out of a solid, in place; `step` (b,): segment lengths."""
    least = solid.margin(step)
    for points in block[1:]:
        points[...] = solid.lift(points, least)


def clump(
    block: Block, guides: Block, guide_idx: NDArray[np.integer], length_ratio: Block, weight: Block
) -> None:
    """Draw strands towards guides, in place.

    Parameters
    ----------
    block : (k, 3, b)            the strands
    guides : (m, k, 3)           the guides
    guide_idx : (b,)             the guide of each strand
    length_ratio : (b,)          length of the strand over that of its guide, <= 1
    weight : (k, b)              0 the strand's own shape, 1 the guide's
    """
    n_points = len(block)
    last = n_points - 1
    for j in range(1, n_points):
        place = length_ratio * np.float32(j)
        near = np.minimum(place.astype(np.int32), last - 1)
        part = place - near
        a, b = guides[guide_idx, near].T, guides[guide_idx, near + 1].T
        block[j] += weight[j] * (a + part * (b - a) - block[j])


def wave(
    block: Block,
    amplitude: Block,
    angle_rate: Block,
    phase: Block,
    side: Block,
    helix: float,
    length: Block,
) -> None:
    """Add a flat wave (helix 0) to a round helix (helix 1) across the strands, in place.

    Parameters
    ----------
    amplitude, angle_rate, phase, length : (b,)   [unit], [rad / unit], [rad], [unit]
    side : (3, b)                the direction of the wave, made perpendicular to each strand and
                                 carried along it without twist
    helix : float                the depth across `side`, relative to that along it
    """
    last = len(block) - 1
    tangents = [block[min(j + 1, last)] - block[max(j - 1, 0)] for j in range(last + 1)]
    for j in range(1, last + 1):
        tangent = normalised(tangents[j])
        side = normalised(side - dot(side, tangent) * tangent)
        arc = length * np.float32(j / last)
        angle = arc * angle_rate + phase
        # Waves grow from nothing at the root over the first turn.
        depth = amplitude * np.minimum(1.0, arc * angle_rate / np.float32(2.0 * np.pi))
        block[j] += (depth * np.cos(angle)) * side
        if helix > 0.0:
            across = np.stack(
                [
                    tangent[1] * side[2] - tangent[2] * side[1],
                    tangent[2] * side[0] - tangent[0] * side[2],
                    tangent[0] * side[1] - tangent[1] * side[0],
                ]
            )
            block[j] += (np.float32(helix) * depth * np.sin(angle)) * across


def frizz(block: Block, amplitude: Block, rng: np.random.Generator) -> None:
    """Let each strand wander by two random slow waves, growing from the root, in place.

    amplitude : (b,)             root mean square offset at the tip [unit]
    """
    last, n = len(block) - 1, block.shape[2]
    for _ in range(2):
        direction = amplitude * rng.standard_normal((3, n), dtype=np.float32) / np.float32(1.7)
        rate = np.float32(np.pi) * (1.0 + 4.0 * rng.random(n, dtype=np.float32))
        phase = np.float32(2.0 * np.pi) * rng.random(n, dtype=np.float32)
        start = np.sin(phase)
        for j in range(1, last + 1):
            s = np.float32(j / last)
            block[j] += direction * ((np.sin(rate * s + phase) - start) * np.sqrt(s))


def tapered_radii(n_points: int, root_radius: Block, tip_radius: float, power: float) -> Block:
    """Radii (b, k): from the root's to a fraction `tip_radius` of it, falling as s^power."""
    s = np.linspace(0.0, 1.0, n_points, dtype=np.float32)
    profile = 1.0 - (1.0 - tip_radius) * s**power
    return root_radius[:, None] * profile[None, :].astype(np.float32)
