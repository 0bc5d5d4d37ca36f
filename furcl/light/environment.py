"""The light around the scene, on the host: what the kernels' environment.clh computes, in float64.

The device gets one float32 buffer: the parameters of `layout.ENVIRONMENT_FIELDS` and, for images,
the texels (H, W, 3), then with light sampling the marginal (H,) and conditional (H, W) tables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.device import layout
from furcl.image.colour import luminance
from furcl.light.latlong import LatLong
from furcl.light.preetham import Sky
from furcl.light.tables import ConstantEnvironment, ImageEnvironment, SkyEnvironment
from furcl.table import triple

Array = NDArray[np.float64]
Settings = ConstantEnvironment | SkyEnvironment | ImageEnvironment

# A part of the sky that sends light at all is sampled at least this often.
MIN_CHANCE = 0.05


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from infinity.

    All functions take unit directions (n, 3) that point away from the scene, world z up. Densities
    are per solid angle [1/sr] and positive wherever there is light; `sample` takes uniform numbers
    (n, 2) in [0, 1).
    """

    kind = ""
    n_negative = 0

    @staticmethod
    def from_scene(settings: Settings) -> Environment:
        """The environment of a scene's table; images are read here.

        Raises
        ------
        ImageError      if the image cannot be used
        """
        if isinstance(settings, ConstantEnvironment):
            return ConstantLight(np.array(triple(settings.radiance), np.float64))
        if isinstance(settings, ImageEnvironment):
            image = LatLong.load(
                settings.file, rotation_deg=settings.rotation_deg, scale=settings.scale
            )
            return ImageLight(image)
        return SkyLight(
            Sky.make(
                sun_elevation=math.radians(settings.sun_elevation_deg),
                sun_azimuth=math.radians(settings.sun_azimuth_deg),
                sun_radius=math.radians(settings.sun_radius_deg),
                sun_scale=settings.sun_scale,
                turbidity=settings.turbidity,
                scale=settings.scale,
                ground_albedo=triple(settings.ground_albedo),
            )
        )

    def radiance(self, dirs: Array) -> Array:
        """Radiance (n, 3)."""
        raise NotImplementedError

    def pdf(self, dirs: Array) -> Array:
        """Density of `sample` (n,)."""
        raise NotImplementedError

    def sample(self, u: Array) -> tuple[Array, Array]:
        """Directions (n, 3) and their densities (n,)."""
        raise NotImplementedError

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        """The flat float32 buffer for the kernels, with tables for sampling if asked for."""
        raise NotImplementedError

    def _parameters(self, **values: Any) -> NDArray[np.float32]:
        fields = layout.ENVIRONMENT_FIELDS[self.kind]
        parts = [np.ravel(values.pop(name)) for name, _ in fields]
        assert not values
        assert [len(p) for p in parts] == [width for _, width in fields]
        return np.concatenate(parts).astype(np.float32)


@dataclass(frozen=True, eq=False)
class ConstantLight(Environment):
    """The same radiance (3,) from everywhere; sampled uniformly."""

    value: Array
    kind = "constant"

    def radiance(self, dirs: Array) -> Array:
        return np.broadcast_to(self.value, (len(dirs), 3)).copy()

    def pdf(self, dirs: Array) -> Array:
        return np.full(len(dirs), 0.25 / math.pi)

    def sample(self, u: Array) -> tuple[Array, Array]:
        dirs = _around_z(2.0 * u[:, 0], u[:, 1])
        return dirs, self.pdf(dirs)

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        return self._parameters(RADIANCE=self.value)


@dataclass(frozen=True, eq=False)
class SkyLight(Environment):
    """Sky, sun and ground; sampling mixes the sun's cone and both hemispheres, uniform in each."""

    sky: Sky
    kind = "sky"

    @property
    def chances(self) -> tuple[float, float, float]:
        """Chances of sampling the sun, the upper and the lower hemisphere, by luminous power."""
        power = luminance(
            np.stack(
                [
                    self.sky.sun_power(),
                    self.sky.sky_integral(cosine=False),
                    2.0 * math.pi * self.sky.ground_radiance,
                ]
            )
        )
        chance = np.where(power > 0.0, np.maximum(power / power.sum(), MIN_CHANCE), 0.0)
        sun, sky, ground = chance / chance.sum()
        return float(sun), float(sky), float(ground)

    def radiance(self, dirs: Array) -> Array:
        return self.sky.radiance(dirs)

    def pdf(self, dirs: Array) -> Array:
        sun, sky, ground = self.chances
        hemisphere = np.where(dirs[:, 2] >= 0.0, sky, ground) / (2.0 * math.pi)
        return hemisphere + self.sky.in_sun(dirs) * (sun / self.sky.sun_solid_angle)

    def sample(self, u: Array) -> tuple[Array, Array]:
        sun, sky, _ = self.chances
        in_cone, above = u[:, 0] < sun, u[:, 0] < sun + sky
        tangent, bitangent = self._sun_frame()
        versine = 2.0 * math.sin(0.5 * self.sky.sun_radius) ** 2
        cone = _around_z(u[:, 0] / max(sun, 1e-300) * versine, u[:, 1])
        dirs = cone @ np.stack([tangent, bitangent, self.sky.sun])
        up = _around_z((u[:, 0] - sun) / sky, u[:, 1])
        down = _around_z((u[:, 0] - sun - sky) / max(1.0 - sun - sky, 1e-300), u[:, 1])
        down[:, 2] *= -1.0
        dirs = np.where(in_cone[:, None], dirs, np.where(above[:, None], up, down))
        return dirs, self.pdf(dirs)

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        sun, sky, _ = self.chances
        tangent, bitangent = self._sun_frame()
        return self._parameters(
            SUN=self.sky.sun,
            SUN_TANGENT=tangent,
            SUN_BITANGENT=bitangent,
            SUN_VERSINE=2.0 * math.sin(0.5 * self.sky.sun_radius) ** 2,
            SUN_RADIANCE=self.sky.sun_radiance,
            SUN_PDF=sun / self.sky.sun_solid_angle,
            SUN_CHANCE=sun,
            SKY_CHANCE=sky,
            GROUND_RADIANCE=self.sky.ground_radiance,
            ZENITH=self.sky.zenith,
            **{f"PEREZ_{name}": self.sky.perez[:, i] for i, name in enumerate("ABCDE")},
        )

    def _sun_frame(self) -> tuple[Array, Array]:
        high = abs(self.sky.sun[2]) > 0.5
        side = np.array([1.0, 0.0, 0.0]) if high else np.array([0.0, 0.0, 1.0])
        tangent = np.cross(side, self.sky.sun)
        tangent /= np.linalg.norm(tangent)
        return tangent, np.cross(self.sky.sun, tangent)


@dataclass(frozen=True, eq=False)
class ImageLight(Environment):
    """A latitude-longitude image, see `furcl.light.latlong`."""

    image: LatLong
    kind = "image"

    @property
    def n_negative(self) -> int:
        """Pixels with a negative channel, which was set to zero."""
        return self.image.n_negative

    def radiance(self, dirs: Array) -> Array:
        return self.image.radiance(dirs)

    def pdf(self, dirs: Array) -> Array:
        return self.image.pdf(dirs)

    def sample(self, u: Array) -> tuple[Array, Array]:
        return self.image.sample(u)

    def device_buffer(self, light_sampling: bool) -> NDArray[np.float32]:
        height, width, _ = self.image.texels.shape
        parts = [
            self._parameters(WIDTH=width, HEIGHT=height, ROTATION=self.image.rotation),
            self.image.texels.ravel(),
        ]
        if light_sampling:
            parts += [self.image.marginal, self.image.conditional.ravel()]
        return np.concatenate(parts)


def _around_z(versine: Array, turns: Array) -> Array:
    """Unit vectors (n, 3) at 1 - cos(theta) = versine and an azimuth in turns."""
    versine = np.clip(versine, 0.0, 2.0)
    level = np.sqrt(versine * (2.0 - versine))
    phi = 2.0 * math.pi * turns
    return np.stack([level * np.cos(phi), level * np.sin(phi), 1.0 - versine], axis=1)
