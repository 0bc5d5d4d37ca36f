"""Cameras that go round a groom."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from furcl.groom.curves import Curves
from furcl.scene.camera import Camera, outermost
from furcl.scene.tables import Scene
from furcl.surface.mesh.mesh import Meshes
from furcl.table import Vec3


def orbit(
    scene: Scene, curves: Curves, angles_deg: Sequence[float], meshes: Meshes | None = None
) -> list[Camera]:
    """The scene's camera, turned by angles around the axis `up`.

    The axis of a camera with an origin goes through its target; its keys are turned with it. One
    that frames turns around the middle of groom, body and meshes and is as far away as the angle
    needs that leaves the least room, so that nothing grows or shrinks from one angle to the next.

    Parameters
    ----------
    curves : Curves             the scene's groom
    angles_deg : floats         counterclockwise, seen from where `up` points to [deg]
    meshes : Meshes or None     those of the scene

    Returns
    -------
    list of Camera              resolved, one an angle
    """
    camera = scene.chosen_camera
    turns = [rotation(camera.up, float(np.radians(angle))) for angle in angles_deg]
    if camera.keys or camera.origin is not None:
        resolved = scene.resolved_camera(curves, meshes)
        pivot = np.asarray(resolved.target)
    else:
        points, radius = scene.points_to_frame(curves, meshes)
        pivot = 0.5 * (points.min(axis=0).astype(np.float64) + points.max(axis=0))
        # Where a turned camera sees a point, the camera itself sees it turned back.
        directions = camera.framing_directions(scene.film.aspect)
        seen = [pivot + (outermost(points, directions @ turn.T) - pivot) @ turn for turn in turns]
        resolved = camera.resolved(np.concatenate(seen), scene.film.aspect, radius)
    return [_turned(resolved, pivot, turn) for turn in turns]


def rotation(axis: Sequence[float], angle: float) -> NDArray[np.float64]:
    """The (3, 3) matrix that turns column vectors around an axis [rad] (Rodrigues)."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def _turned(camera: Camera, pivot: NDArray[np.float64], turn: NDArray[np.float64]) -> Camera:
    origin, target = (
        pivot + turn @ (np.asarray(place) - pivot) for place in (camera.origin, camera.target)
    )
    keys = tuple(
        msgspec.structs.replace(
            key,
            origin=_tuple(pivot + turn @ (np.asarray(key.origin) - pivot)),
            target=_tuple(pivot + turn @ (np.asarray(key.target) - pivot)),
            up=_tuple(turn @ np.asarray(key.up)),
        )
        for key in camera.keys
    )
    return msgspec.structs.replace(camera, origin=_tuple(origin), target=_tuple(target), keys=keys)


def _tuple(place: NDArray[np.float64]) -> Vec3:
    x, y, z = place.tolist()
    return x, y, z
