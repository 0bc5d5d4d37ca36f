"""The rays that `furcl bench intersect` traces: camera rays, scattered rays, shadow rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import NO_SEGMENT
from furcl.groom.curves import Curves
from furcl.oracle.embree_rays import EmbreeScene
from furcl.scene.camera import Camera

FAR = np.float32(1e30)
BOUNCES = 4
TILE = 4


@dataclass(frozen=True, eq=False)
class RaySet:
    """Rays of one kind.

    Attributes
    ----------
    name : str
    any_hit : bool                  only whether something is hit counts
    origins, directions : (n, 4) float32    as EmbreeScene.intersect
    """

    name: str
    any_hit: bool
    origins: NDArray[np.float32]
    directions: NDArray[np.float32]


def ray_sets(curves: Curves, camera: Camera, size: int, scene: EmbreeScene, seed: int):
    """Primary, first-bounce, fourth-bounce and shadow rays.

    primary     one jittered camera ray a pixel, in tiles of 4 x 4 pixels
    bounce1     from the primary hits, uniform over the sphere, in the order of their pixels
    bounce4     after four such bounces, shuffled: nothing that follows is near
    shadow      from the primary hits to points of a square light

    A scattered ray starts outside the fibre that it leaves: from the axis 4 r / sin(angle to the
    tangent) along the ray, where a renderer would begin to count hits of that fibre. So both
    tracers are given one and the same ray, and nothing needs to be left out.

    Parameters
    ----------
    camera : Camera         resolved
    size : int              width and height of the picture [px], a multiple of 4
    """
    rng = np.random.default_rng(seed)
    lo, hi = curves.bounds()
    primary = _primary(camera, size, rng)
    hits = scene.intersect(*primary)[1:]
    light = _light_points(lo, hi, int((hits[0] != NO_SEGMENT).sum()), rng)
    shadow = _leave(curves, *hits, light, rng)
    rays = bounce1 = _leave(curves, *hits, None, rng)
    for _ in range(BOUNCES - 1):
        rays = _leave(curves, *scene.intersect(*rays)[1:], None, rng)
    order = rng.permutation(len(rays[0]))
    return [
        RaySet("primary", False, *primary),
        RaySet("bounce1", False, *bounce1),
        RaySet("bounce4", False, rays[0][order], rays[1][order]),
        RaySet("shadow", True, *shadow),
    ]


def _pack(xyz, w):
    out = np.empty((len(xyz), 4), np.float32)
    out[:, :3], out[:, 3] = xyz, w
    return out


def _unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _primary(camera: Camera, size: int, rng):
    tiles, inside = np.arange(size // TILE), np.arange(TILE)
    tile_y, tile_x, y, x = np.meshgrid(tiles, tiles, inside, inside, indexing="ij")
    px = (TILE * tile_x + x).ravel() + rng.random(size * size)
    py = (TILE * tile_y + y).ravel() + rng.random(size * size)
    origins, directions = camera.rays(px / size, py / size)
    return _pack(origins, 0.0), _pack(directions, FAR)


def _light_points(lo, hi, n, rng):
    """Points of a square above and beside the groom."""
    centre, size = 0.5 * (lo + hi), (hi - lo).max()
    square = np.column_stack([rng.uniform(-0.3, 0.3, (n, 2)), np.zeros(n)])
    return centre + size * (np.array([-0.8, -0.8, 1.2]) + square)


def _leave(curves: Curves, segment, u, target, rng):
    """Rays from the hits, towards `target` (n, 3), or uniform over the sphere."""
    hit = segment != NO_SEGMENT
    v, w = segment[hit].astype(np.int64), u[hit, None].astype(np.float64)
    a, b = curves.points[v].astype(np.float64), curves.points[v + 1].astype(np.float64)
    position = a + w * (b - a)
    radius = curves.radii[v] * (1.0 - w[:, 0]) + curves.radii[v + 1] * w[:, 0]
    way = rng.standard_normal(a.shape) if target is None else target - position
    d = _unit(way)
    sine = np.linalg.norm(np.cross(d, _unit(b - a)), axis=1)
    skip = 4.0 * radius / np.maximum(sine, 1e-3)
    far = FAR if target is None else np.maximum(np.linalg.norm(way, axis=1) - skip, 0.0)
    return _pack(position + skip[:, None] * d, 0.0), _pack(d, far)
