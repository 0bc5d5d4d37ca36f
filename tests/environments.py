"""Small environments of every kind that several tests share."""

from __future__ import annotations

import numpy as np

from furcl.light import kinds
from furcl.light.constant import ConstantEnvironment
from furcl.light.image import ImageLight
from furcl.light.latlong import LatLong
from furcl.light.model import Light
from furcl.light.sky import SkyEnvironment

ENVIRONMENTS = ("constant", "sky", "low sky", "sunless sky", "image", "turned image")
# Where light arrives makes no difference to what comes from infinity.
ANYWHERE = np.array([3.0, -1.0, 7.0])


def make_environment(name: str) -> Light:
    """One of ENVIRONMENTS; suns are broad, so that histograms can resolve them."""
    if name == "constant":
        return kinds.from_table(ConstantEnvironment(radiance=(1.0, 2.0, 3.0)))
    if name.endswith("sky"):
        low, dark = name == "low sky", name == "sunless sky"
        settings = SkyEnvironment(
            sun_elevation_deg=3.0 if low else 50.0,
            sun_azimuth_deg=200.0,
            sun_radius_deg=15.0,
            sun_scale=0.0 if dark else 0.3,
            ground_albedo=0.0 if dark else 0.3,
        )
        return kinds.from_table(settings)
    rng = np.random.default_rng(5)
    rgb = rng.exponential(size=(8, 16, 3)).astype(np.float32) ** 2
    rgb[2, 14] = 40.0
    return ImageLight(LatLong.make(rgb, rotation_deg=0.0 if name == "image" else 77.0))
