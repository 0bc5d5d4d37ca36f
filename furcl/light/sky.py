"""Daylight: sky, sun and ground of `furcl.light.preetham`. Its kernel:
kernels/include/light/sky.clh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from furcl.image.colour import luminance
from furcl.light.compensation import compensated_power
from furcl.light.model import Light
from furcl.light.preetham import Sky
from furcl.light.sample import LightSamples, around_z, from_infinity
from furcl.table import Rgb, Table, triple

Array = NDArray[np.float64]


class SkyEnvironment(Table, frozen=True, kw_only=True, tag_field="kind", tag="sky"):
    """Clear daylight sky with a sun disc over a ground of constant radiance, see
    `furcl.light.preetham`.

    Attributes
    ----------
    sun_elevation_deg : float   of the sun over the horizon [deg]
    sun_azimuth_deg : float     of the sun, from +x towards +y [deg]
    sun_radius_deg : float      of the sun's disc; its illuminance stays: a broader sun is dimmer
                                [deg]
    sun_scale : float           factor on the sun; 0 leaves the disc out
    turbidity : float           haze: 2 is clear, 10 hazy
    scale : float               what turns kcd/m^2 into radiance
    ground_albedo : (r,g,b)     what the ground reflects of the light that falls on it; one number
                                stands for three equal ones
    """

    allowed: ClassVar = {"ground_albedo": (0.0, 1.0)}

    sun_elevation_deg: Annotated[float, Meta(ge=0.0, le=90.0)] = 45.0
    sun_azimuth_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    sun_radius_deg: Annotated[float, Meta(ge=0.05, le=30.0)] = 0.2665
    sun_scale: Annotated[float, Meta(ge=0.0, le=1e6)] = 1.0
    turbidity: Annotated[float, Meta(ge=2.0, le=10.0)] = 3.0
    scale: Annotated[float, Meta(gt=0.0, le=1e6)] = 0.05
    ground_albedo: Rgb = 0.2


@dataclass(frozen=True, eq=False)
class SkyLight(Light):
    """Sky, sun and ground; sampling mixes the sun's cone and both hemispheres, uniform in each."""

    sky: Sky

    kind = "sky"
    table = SkyEnvironment
    header = Path("light/sky.clh")
    fields = (
        ("SUN", 3),  # unit, to the sun's centre
        ("SUN_TANGENT", 3),  # unit, with SUN_BITANGENT a right-handed frame around SUN
        ("SUN_BITANGENT", 3),
        ("SUN_ONE_MINUS_COS", 1),  # 1 - cos(radius)
        ("SUN_RADIANCE", 3),
        ("SUN_PDF", 1),  # chance of sampling the sun over its solid angle [1/sr]
        ("SUN_CHANCE", 1),
        ("SKY_CHANCE", 1),  # of the upper hemisphere; the rest is the lower one
        ("GROUND_RADIANCE", 3),
        ("ZENITH", 3),
        ("PEREZ_A", 3),  # of Y, x, y; so are the next four
        ("PEREZ_B", 3),
        ("PEREZ_C", 3),
        ("PEREZ_D", 3),
        ("PEREZ_E", 3),
    )

    @classmethod
    def from_table(cls, table: SkyEnvironment) -> Self:
        return cls(
            Sky.make(
                sun_elevation=math.radians(table.sun_elevation_deg),
                sun_azimuth=math.radians(table.sun_azimuth_deg),
                sun_radius=math.radians(table.sun_radius_deg),
                sun_scale=table.sun_scale,
                turbidity=table.turbidity,
                scale=table.scale,
                ground_albedo=triple(table.ground_albedo),
            )
        )

    @cached_property
    def chances(self) -> tuple[float, float, float]:
        """Chances of sampling the sun, the upper and the lower hemisphere, by
        `compensated_power`."""
        power = luminance(
            np.stack(
                [
                    self.sky.sun_power(),
                    self.sky.sky_integral(cosine=False),
                    2.0 * math.pi * self.sky.ground_radiance,
                ]
            )
        )
        hemisphere = 2.0 * math.pi
        angles = np.array([self.sky.sun_solid_angle, hemisphere, hemisphere])
        chance = compensated_power(np.asarray(power, np.float64), angles)
        sun, sky, ground = chance / chance.sum()
        return float(sun), float(sky), float(ground)

    def radiance(self, directions: Array) -> Array:
        return self.sky.radiance(directions)

    def pdf(self, points: Array, directions: Array) -> Array:
        sun, sky, ground = self.chances
        hemisphere = np.where(directions[:, 2] >= 0.0, sky, ground) / (2.0 * math.pi)
        return hemisphere + self.sky.in_sun(directions) * (sun / self.sky.sun_solid_angle)

    def sample(self, points: Array, u: Array) -> LightSamples:
        sun, sky, _ = self.chances
        in_cone, above = u[:, 0] < sun, u[:, 0] < sun + sky
        tangent, bitangent = self._sun_frame()
        one_minus_cos = 2.0 * math.sin(0.5 * self.sky.sun_radius) ** 2
        cone = around_z(u[:, 0] / max(sun, 1e-300) * one_minus_cos, u[:, 1])
        directions = cone @ np.stack([tangent, bitangent, self.sky.sun])
        up = around_z((u[:, 0] - sun) / sky, u[:, 1])
        down = around_z((u[:, 0] - sun - sky) / max(1.0 - sun - sky, 1e-300), u[:, 1])
        down[:, 2] *= -1.0
        directions = np.where(in_cone[:, None], directions, np.where(above[:, None], up, down))
        return from_infinity(directions, self.radiance(directions), self.pdf(points, directions))

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        sun, sky, _ = self.chances
        tangent, bitangent = self._sun_frame()
        return self.parameters(
            {
                "SUN": self.sky.sun,
                "SUN_TANGENT": tangent,
                "SUN_BITANGENT": bitangent,
                "SUN_ONE_MINUS_COS": 2.0 * math.sin(0.5 * self.sky.sun_radius) ** 2,
                "SUN_RADIANCE": self.sky.sun_radiance,
                "SUN_PDF": sun / self.sky.sun_solid_angle,
                "SUN_CHANCE": sun,
                "SKY_CHANCE": sky,
                "GROUND_RADIANCE": self.sky.ground_radiance,
                "ZENITH": self.sky.zenith,
                **{f"PEREZ_{name}": self.sky.perez[:, i] for i, name in enumerate("ABCDE")},
            }
        )

    def _sun_frame(self) -> tuple[Array, Array]:
        high = abs(self.sky.sun[2]) > 0.5
        side = np.array([1.0, 0.0, 0.0]) if high else np.array([0.0, 0.0, 1.0])
        tangent = np.cross(side, self.sky.sun)
        tangent /= np.linalg.norm(tangent)
        return tangent, np.cross(self.sky.sun, tangent)
