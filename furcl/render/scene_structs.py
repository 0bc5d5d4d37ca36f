"""The camera of a scene as the struct that the kernels take."""

from __future__ import annotations

import math

import numpy as np

from furcl.device import layout
from furcl.groom.curves import Curves
from furcl.scene.tables import Scene


def camera_struct(scene: Scene, curves: Curves) -> np.ndarray:
    """The struct Camera of a scene; frames the groom where the scene leaves that open."""
    camera = scene.resolved_camera(curves)
    origin, right, up, forward = camera.frame()
    height = math.tan(0.5 * math.radians(camera.vfov_deg))
    out = np.zeros((), layout.struct_dtype("Camera"))
    out["origin"][:3] = origin
    out["right"][:3] = right * height * scene.film.aspect
    out["up"][:3] = up * height
    out["forward"][:3] = forward
    out["aperture_radius"] = camera.aperture_radius
    out["focus_distance"] = camera.focus_distance or 0.0
    out["filter_radius_px"] = scene.film.support_px
    return out
