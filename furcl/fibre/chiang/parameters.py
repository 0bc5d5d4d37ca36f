"""The parameters of a fibre of Chiang et al. 2016, and named sets of them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import ClassVar

from furcl.fibre.pigment import albedo_polynomial, check_colour
from furcl.fibre.ranges import Range, Triple, check_parameters

RANGES: dict[str, Range] = {
    "eta": (1.0001, 3.0),
    "beta_m": (0.01, 1.0),
    "beta_n": (0.01, 1.0),
    "alpha_deg": (-20.0, 20.0),
    "sigma_a": (0.0, 1e4),
}


@dataclasses.dataclass(frozen=True)
class ChiangFibre:
    """A cylinder with roughnesses that look even: the hair of pbrt, Mitsuba and Cycles.

    Parameters
    ----------
    eta : float         index of refraction, inside over outside, 1.0001..3
    beta_m : float      longitudinal roughness, 0.01..1
    beta_n : float      azimuthal roughness, 0.01..1
    alpha_deg : float   tilt of the cuticle scales; the sign is ignored: R always moves towards the
                        root, -20..20 [deg]
    sigma_a : (r,g,b)   absorption; one number stands for three equal ones, 0..1e4
                        [1 / fibre radius]

    Raises
    ------
    FibreError          names the parameter, its value and the allowed range
    """

    model: ClassVar[str] = "chiang"

    eta: float = 1.55
    beta_m: float = 0.3
    beta_n: float = 0.3
    alpha_deg: float = 2.0
    sigma_a: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_parameters(self, RANGES, ("sigma_a",))

    @property
    def tilt(self) -> float:
        """The tilt that the lobes use, -|alpha| [rad]: negative moves R towards the root."""
        return -abs(math.radians(self.alpha_deg))

    @property
    def longitudinal_width(self) -> float:
        """Standard deviation of R [rad]; of TT half, of later orders twice that."""
        b = self.beta_m
        return 0.726 * b + 0.812 * b * b + 3.7 * b**20

    @property
    def azimuthal_scale(self) -> float:
        """Scale of the logistic [rad]."""
        b = self.beta_n
        return math.sqrt(math.pi / 8.0) * (0.265 * b + 1.194 * b * b + 5.372 * b**22)


def sigma_a_from_colour(colour: Sequence[float], beta_n: float) -> Triple:
    """Absorption for which a thick groom takes about the given colour, by the fit of Chiang et al.
    2016.

    Parameters
    ----------
    colour : (r, g, b)      wanted multiple-scattering albedo, linear, each 1e-6..1
    beta_n : float          azimuthal roughness, 0.01..1

    Returns
    -------
    (r, g, b)               absorption per fibre radius, >= 0

    Raises
    ------
    FibreError              a channel outside its range
    """
    scale = albedo_polynomial(beta_n)
    r, g, b = ((math.log(c) / scale) ** 2 for c in check_colour(colour))
    return r, g, b
