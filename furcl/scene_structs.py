"""Camera and body of a scene as the structs that the kernels take."""

from __future__ import annotations

import math

import numpy as np

from furcl import layout
from furcl.curves import Curves
from furcl.scene import Scene, triple

# Where the body is that kernels with body code get for a scene without one.
NOWHERE = 1e12


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


def body_struct(scene: Scene) -> np.ndarray:
    """The struct Body of a scene; without one a unit sphere that no ray meets."""
    out = np.zeros((), layout.struct_dtype("Body"))
    out["centre"][:3], out["inv_radii"][:3] = NOWHERE, 1.0
    if scene.body is not None:
        out["centre"][:3] = scene.body.centre
        out["inv_radii"][:3] = np.reciprocal(np.array(scene.body.radii, np.float64))
        out["albedo"][:3] = triple(scene.body.albedo)
    return out
