"""Cameras moved by hand: around their target, beside it, and towards it."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
from numpy.typing import NDArray

from furcl.scene.camera import Camera
from furcl.scene.orbit import rotation
from furcl.table import Vec3

#: The view stays so far from the axis `up`, where it has no upright picture [deg].
CLOSEST_TO_UP_DEG = 1.0

Array = NDArray[np.float64]


def orbited(camera: Camera, azimuth_deg: float, elevation_deg: float) -> Camera:
    """A resolved camera turned around its target: by an azimuth around `up`, counterclockwise seen
    from where that points to, and by an elevation towards it, which ends short of it."""
    target = np.asarray(camera.target, np.float64)
    back = np.asarray(camera.origin, np.float64) - target
    up = np.asarray(camera.up, np.float64)
    cosine = back @ up / (np.linalg.norm(back) * np.linalg.norm(up))
    from_up = math.degrees(math.acos(float(np.clip(cosine, -1.0, 1.0))))
    least, most = CLOSEST_TO_UP_DEG - from_up, 180.0 - CLOSEST_TO_UP_DEG - from_up
    # A smaller angle to `up` is a higher place.
    downwards = min(max(-elevation_deg, least), most)
    _, right, _, _ = camera.frame()
    turn = rotation(camera.up, math.radians(azimuth_deg)) @ rotation(
        right.tolist(), math.radians(downwards)
    )
    return _moved(camera, lambda place: target + turn @ (place - target))


def shifted(camera: Camera, right: float, up: float) -> Camera:
    """A resolved camera moved with its target, in heights of what is seen at the target."""
    _, right_axis, up_axis, _ = camera.frame()
    height = 2.0 * camera.half_height * (1.0 if camera.orthographic else _distance(camera))
    step = height * (right * right_axis + up * up_axis)
    return _moved(camera, lambda place: place + step)


def dollied(camera: Camera, factor: float) -> Camera:
    """A resolved camera with its distance to the target multiplied, or with the height that it
    sees, of an orthographic one."""
    if camera.orthographic:
        assert camera.height is not None
        return msgspec.structs.replace(camera, height=camera.height * factor)
    target = np.asarray(camera.target, np.float64)
    step = (factor - 1.0) * (np.asarray(camera.origin, np.float64) - target)
    return _moved(camera, lambda place: place + step, only_origin=True)


def angles(camera: Camera) -> dict[str, float]:
    """Azimuth and elevation of a resolved camera seen from its target [deg], and its distance."""
    x, y, z = np.subtract(np.asarray(camera.origin), np.asarray(camera.target)).tolist()
    return {
        "azimuth_deg": math.degrees(math.atan2(y, x)),
        "elevation_deg": math.degrees(math.atan2(z, math.hypot(x, y))),
        "distance": _distance(camera),
    }


def _distance(camera: Camera) -> float:
    return float(np.linalg.norm(np.subtract(np.asarray(camera.origin), np.asarray(camera.target))))


def _moved(camera: Camera, place: Callable[[Array], Array], *, only_origin: bool = False) -> Camera:
    """A camera with its places moved, and those of its keys."""
    names = ("origin",) if only_origin else ("origin", "target")

    def new(of: Camera | msgspec.Struct) -> dict[str, Vec3]:
        found = {}
        for name in names:
            x, y, z = place(np.asarray(getattr(of, name), np.float64)).tolist()
            found[name] = (x, y, z)
        return found

    keys = tuple(msgspec.structs.replace(key, **new(key)) for key in camera.keys)
    moved = msgspec.structs.replace(camera, keys=keys, **new(camera))
    if camera.focus_distance == _distance(camera):  # the target's
        moved = msgspec.structs.replace(moved, focus_distance=_distance(moved))
    return moved
