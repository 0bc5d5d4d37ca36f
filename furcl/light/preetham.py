"""The analytic daylight sky of Preetham, Shirley and Smits 1999, in closed form and float64.

Radiance is linear Rec.709 with luminances in kcd/m^2, times a scale. Three parts: the sky above the
horizon, a sun disc of uniform radiance clipped by the horizon, a ground of constant radiance below.
Outside the gamut of Rec.709 a channel of the sky is zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Coefficients A to E of the Perez formula for luminance Y and chromaticities x and y: (slope,
# offset) in the turbidity. Preetham et al. 1999, appendix A.2.
PEREZ = {
    "Y": ((0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771),
          (-0.0670, 0.3703)),
    "x": ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989),
          (-0.0033, 0.0452)),
    "y": ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537),
          (-0.0109, 0.0529)),
}  # fmt: skip
# Chromaticity of the zenith: rows turbidity^2, turbidity, 1; columns theta_sun^3, ^2, ^1, 1.
ZENITH_X = (
    (0.00166, -0.00375, 0.00209, 0.0),
    (-0.02903, 0.06377, -0.03202, 0.00394),
    (0.11693, -0.21196, 0.06052, 0.25886),
)
ZENITH_Y = (
    (0.00275, -0.00610, 0.00317, 0.0),
    (-0.04214, 0.08970, -0.04153, 0.00516),
    (0.15346, -0.26756, 0.06670, 0.26688),
)
XYZ_TO_REC709 = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
# Illuminance of the sun outside the atmosphere [klx] and the wavelengths [um] that stand for R, G
# and B.
SOLAR_ILLUMINANCE_KLX = 128.0
WAVELENGTHS_UM = np.array([0.610, 0.550, 0.465])
# At this cosine the horizon factors exp(B / cos) are below 1e-57: 0 in float32.
MIN_COS = 1e-3


@dataclass(frozen=True)
class Sky:
    """Closed-form sky, sun and ground.

    Attributes
    ----------
    sun : (3,) float64              unit direction to the sun's centre
    sun_radius : float              angular radius of the disc [rad]
    sun_radiance : (3,) float64     of the disc, on top of the sky behind it
    ground_radiance : (3,) float64
    perez : (3, 5) float64          rows Y, x, y; columns A to E
    zenith : (3,) float64           Y (scaled), x, y over F(0, theta_sun), the factor before the
                                    Perez formula
    """

    sun: Array
    sun_radius: float
    sun_radiance: Array
    ground_radiance: Array
    perez: Array
    zenith: Array

    @classmethod
    def make(
        cls,
        *,
        sun_elevation: float,
        sun_azimuth: float,
        sun_radius: float,
        sun_scale: float,
        turbidity: float,
        scale: float,
        ground_albedo: tuple[float, float, float],
    ) -> Sky:
        """The sky for a sun at an elevation of 0..pi/2 [rad] and a turbidity of 2..10."""
        theta = math.pi / 2.0 - sun_elevation
        level = math.cos(sun_elevation)
        sun = np.array(
            [level * math.cos(sun_azimuth), level * math.sin(sun_azimuth), math.sin(sun_elevation)]
        )
        perez = np.array([[m * turbidity + c for m, c in PEREZ[key]] for key in "Yxy"])
        zenith = np.array(
            [
                scale * zenith_luminance(turbidity, theta),
                _zenith_chromaticity(ZENITH_X, turbidity, theta),
                _zenith_chromaticity(ZENITH_Y, turbidity, theta),
            ]
        )
        zenith /= [_perez(row, np.array(1.0), np.array(theta)) for row in perez]
        disc = math.pi * math.sin(sun_radius) ** 2
        sun_radiance = scale * sun_scale * sun_illuminance(turbidity, theta) / disc
        sky = cls(sun, sun_radius, sun_radiance, np.zeros(3), perez, zenith)
        irradiance = sky.sky_integral(cosine=True) + sky.sun_irradiance()
        ground = np.asarray(ground_albedo) * irradiance / math.pi
        return cls(sun, sun_radius, sun_radiance, ground, perez, zenith)

    def radiance(self, dirs: Array) -> Array:
        """Radiance from unit directions (n, 3), (n, 3)."""
        result = np.where(dirs[:, 2:] >= 0.0, self.sky_radiance(dirs), self.ground_radiance)
        return result + np.where(
            (self.in_sun(dirs) & (dirs[:, 2] >= 0.0))[:, None], self.sun_radiance, 0.0
        )

    def in_sun(self, dirs: Array) -> NDArray[np.bool_]:
        """Whether unit directions (n, 3) are in the sun's cone, also below the horizon."""
        chord_sq = np.sum((dirs - self.sun) ** 2, axis=1)
        return chord_sq <= (2.0 * math.sin(0.5 * self.sun_radius)) ** 2

    def sky_radiance(self, dirs: Array) -> Array:
        """Radiance of the sky alone (n, 3), meaningful for z >= 0."""
        cos_theta = np.maximum(dirs[:, 2], MIN_COS)
        chord = np.linalg.norm(dirs - self.sun, axis=1)
        gamma = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
        luminance, x, y = (
            z * _perez(row, cos_theta, gamma)
            for z, row in zip(self.zenith, self.perez, strict=True)
        )
        xyz = np.stack([x, y, 1.0 - x - y], axis=1) * (luminance / y)[:, None]
        return np.maximum(xyz @ XYZ_TO_REC709.T, 0.0)

    def sky_integral(self, cosine: bool) -> Array:
        """Integral (3,) of the sky's radiance over the upper hemisphere, with cos(theta) or not.

        Midpoint rule in azimuth, Gauss-Legendre in z; relative error below 1e-4
        (test_environment.py::test_sky_integral).
        """
        dirs, weight = _hemisphere()
        return (weight * dirs[:, 2] if cosine else weight) @ self.sky_radiance(dirs)

    def sun_irradiance(self) -> Array:
        """Irradiance (3,) that the disc, were it wholly above the horizon, sends to the ground."""
        return self.sun_radiance * math.pi * math.sin(self.sun_radius) ** 2 * self.sun[2]

    def sun_power(self) -> Array:
        """Integral of the disc's radiance over all its directions (3,), as if wholly risen."""
        return self.sun_radiance * self.sun_solid_angle

    @property
    def sun_solid_angle(self) -> float:
        """Of the whole disc [sr]."""
        return 4.0 * math.pi * math.sin(0.5 * self.sun_radius) ** 2


@cache
def _hemisphere() -> tuple[Array, Array]:
    """Directions (n, 3) of the upper hemisphere and their weights (n,) [sr]."""
    nodes, weights = np.polynomial.legendre.leggauss(128)
    z, n_phi = 0.5 * (nodes + 1.0), 256
    phi = (np.arange(n_phi) + 0.5) * (2.0 * math.pi / n_phi)
    radius = np.sqrt((1.0 - z) * (1.0 + z))
    dirs = np.stack(
        [
            np.outer(radius, np.cos(phi)).ravel(),
            np.outer(radius, np.sin(phi)).ravel(),
            np.repeat(z, n_phi),
        ],
        axis=1,
    )
    return dirs, np.repeat(0.5 * weights, n_phi) * (2.0 * math.pi / n_phi)


def zenith_luminance(turbidity: float, theta_sun: float) -> float:
    """Luminance of the zenith [kcd/m^2] with the sun at the polar angle `theta_sun` [rad].

    Source: Preetham et al. 1999, appendix A.2.
    """
    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * theta_sun)
    return (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192


def sun_illuminance(turbidity: float, theta_sun: float) -> Array:
    """Illuminance on a plane facing the sun [klx], (r, g, b).

    Rayleigh and aerosol extinction of Preetham et al. 1999, appendix A.1, at one wavelength a
    channel; the weaker absorption by ozone, mixed gases and water is left out and the sun outside
    the air is white.
    """
    elevation_deg = 90.0 - math.degrees(theta_sun)
    mass = 1.0 / (math.cos(theta_sun) + 0.15 * (elevation_deg + 3.885) ** -1.253)
    rayleigh = 0.008735 * WAVELENGTHS_UM**-4.08
    aerosol = (0.04608 * turbidity - 0.04586) * WAVELENGTHS_UM**-1.3
    return SOLAR_ILLUMINANCE_KLX * np.exp(-mass * (rayleigh + aerosol))


def _perez(row: Array, cos_theta: Array, gamma: Array) -> Array:
    a, b, c, d, e = row
    return (1.0 + a * np.exp(b / cos_theta)) * (
        1.0 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2
    )


def _zenith_chromaticity(
    matrix: tuple[tuple[float, ...], ...], turbidity: float, theta: float
) -> float:
    powers = np.array([theta**3, theta**2, theta, 1.0])
    return float(np.array([turbidity**2, turbidity, 1.0]) @ np.array(matrix) @ powers)
