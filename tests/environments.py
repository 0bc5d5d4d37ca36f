"""Small environments of every kind that several tests share."""

from __future__ import annotations

import numpy as np

from furcl.light.environment import Environment, ImageLight
from furcl.light.latlong import LatLong
from furcl.light.tables import ConstantEnvironment, SkyEnvironment

ENVIRONMENTS = ("constant", "sky", "low sky", "sunless sky", "image", "turned image")


def make_environment(name: str) -> Environment:
    """One of ENVIRONMENTS; suns are broad, so that histograms can resolve them."""
    if name == "constant":
        return Environment.from_scene(ConstantEnvironment(radiance=(1.0, 2.0, 3.0)))
    if name.endswith("sky"):
        low, dark = name == "low sky", name == "sunless sky"
        settings = SkyEnvironment(
            sun_elevation_deg=3.0 if low else 50.0,
            sun_azimuth_deg=200.0,
            sun_radius_deg=15.0,
            sun_scale=0.0 if dark else 0.3,
            ground_albedo=0.0 if dark else 0.3,
        )
        return Environment.from_scene(settings)
    rng = np.random.default_rng(5)
    rgb = rng.exponential(size=(8, 16, 3)).astype(np.float32) ** 2
    rgb[2, 14] = 40.0
    return ImageLight(LatLong.make(rgb, rotation_deg=0.0 if name == "image" else 77.0))
