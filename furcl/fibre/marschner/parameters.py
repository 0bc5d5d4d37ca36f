"""The parameters of a fibre of Marschner et al. 2003."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar, NamedTuple

from furcl.errors import FibreError
from furcl.fibre.ranges import Range, Triple, check_parameters

RANGES: dict[str, Range] = {
    "eta": (1.1, 3.0),
    "alpha_deg": (-20.0, 20.0),
    "beta_deg": (0.12, 45.0),
    "sigma_a": (0.0, 1e4),
    "glint": (0.0, 10.0),
    "caustic_width_deg": (1.0, 30.0),
    "caustic_fade": (0.01, 2.0),
    "caustic_limit": (0.01, 1.0),
    "axis_ratio": (0.75, 1.0),
}
NORMS = ("unit", "published")


class Along(NamedTuple):
    """Scattering of a lobe along the fibre, over half the sum of the inclinations."""

    shift: float
    """Centre [rad]; negative is towards the root."""
    width: float
    """Standard deviation [rad]."""


@dataclasses.dataclass(frozen=True)
class MarschnerFibre:
    """A smooth cylinder with bells along it: the model that later ones correct.

    Parameters
    ----------
    eta : float             index of refraction, inside over outside, 1.1..3
    alpha_deg : float       tilt of the cuticle scales; the sign is ignored: R always moves towards
                            the root, -20..20 [deg]
    beta_deg : float        width of R along the fibre, standard deviation of half the sum of the
                            inclinations; of TT half, of TRT twice that, 0.12..45 [deg]
    sigma_a : (r,g,b)       absorption; one number stands for three equal ones, 0..1e4
                            [1 / fibre radius]
    glint : float           k_G: energy of the glints over that of the light that they stand for,
                            0..10
    caustic_width_deg : float   w_c: width of a glint around the fibre, standard deviation,
                                1..30 [deg]
    caustic_fade : float    range of eta' above 2 in which the glints fade, 0.01..2
    caustic_limit : float   largest range of offsets whose light a glint stands for, 0.01..1
    axis_ratio : float      eccentricity: minor over major axis of the cross-section, in TRT alone;
                            the float64 reference knows it, renders take circles, 0.75..1
    norm : str              "unit", or "published": twice the light, as the paper prints it

    Raises
    ------
    FibreError      names the parameter, its value and the allowed range
    """

    model: ClassVar[str] = "marschner"

    eta: float = 1.55
    alpha_deg: float = 7.5
    beta_deg: float = 7.5
    sigma_a: Triple = (0.0, 0.0, 0.0)
    glint: float = 1.0
    caustic_width_deg: float = 15.0
    caustic_fade: float = 0.3
    caustic_limit: float = 0.5
    axis_ratio: float = 1.0
    norm: str = "unit"

    def __post_init__(self) -> None:
        check_parameters(self, RANGES, ("sigma_a",))
        if self.norm not in NORMS:
            raise FibreError(
                f"fibre.norm = {self.norm!r} - allowed are {' and '.join(map(repr, NORMS))}"
            )

    @property
    def lobes(self) -> tuple[Along, Along, Along]:
        """Of R, TT and TRT: a, -a/2, -3a/2 and beta, beta/2, 2 beta with a = -|alpha|."""
        a, b = -abs(math.radians(self.alpha_deg)), math.radians(self.beta_deg)
        return Along(a, b), Along(-0.5 * a, 0.5 * b), Along(-1.5 * a, 2.0 * b)

    @property
    def caustic_width(self) -> float:
        """Width of a glint [rad]."""
        return math.radians(self.caustic_width_deg)

    @property
    def twice_norm(self) -> float:
        """Twice the factor k of the model: with 1 the smooth cylinder keeps its energy."""
        return 1.0 if self.norm == "unit" else 2.0
