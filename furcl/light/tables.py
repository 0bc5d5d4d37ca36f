"""The tables of environments in a scene."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from furcl.table import Rgb, Table, check_range


class ConstantEnvironment(Table, frozen=True, kw_only=True, tag_field="kind", tag="constant"):
    """The same radiance from everywhere."""

    radiance: Rgb = 1.0

    def __post_init__(self) -> None:
        check_range("radiance", self.radiance, 0.0, 1e9)


class SkyEnvironment(Table, frozen=True, kw_only=True, tag_field="kind", tag="sky"):
    """Clear daylight sky with a sun disc over a ground of constant radiance, see `furcl.light.sky`.

    `scale` turns kcd/m^2 into radiance. The sun's illuminance does not depend on `sun_radius_deg`:
    a broader sun is dimmer. `sun_scale` = 0 leaves the disc out. The ground's radiance follows from
    the light that falls on it and `ground_albedo`.
    """

    sun_elevation_deg: Annotated[float, Meta(ge=0.0, le=90.0)] = 45.0
    sun_azimuth_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    sun_radius_deg: Annotated[float, Meta(ge=0.05, le=30.0)] = 0.2665
    sun_scale: Annotated[float, Meta(ge=0.0, le=1e6)] = 1.0
    turbidity: Annotated[float, Meta(ge=2.0, le=10.0)] = 3.0
    scale: Annotated[float, Meta(gt=0.0, le=1e6)] = 0.05
    ground_albedo: Rgb = 0.2

    def __post_init__(self) -> None:
        check_range("ground_albedo", self.ground_albedo, 0.0, 1.0)


class ImageEnvironment(Table, frozen=True, kw_only=True, tag_field="kind", tag="image"):
    """Latitude-longitude image (.exr or .hdr), turned about +z by `rotation_deg`, times `scale`."""

    file: str
    rotation_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    scale: Annotated[float, Meta(gt=0.0, le=1e6)] = 1.0
