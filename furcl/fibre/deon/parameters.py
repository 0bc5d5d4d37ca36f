"""The parameters of a fibre of d'Eon et al. 2011."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

from furcl.errors import FibreError
from furcl.fibre.pigment import BETA_RANGE_DEG
from furcl.fibre.ranges import Range, Triple, check_parameters

RANGES: dict[str, Range] = {
    "eta": (1.0001, 3.0),
    "alpha_deg": (-20.0, 20.0),
    "beta_m_deg": BETA_RANGE_DEG,
    "beta_n_deg": BETA_RANGE_DEG,
    "sigma_a": (0.0, 1e4),
}
ORDERS = (3, 8)


@dataclasses.dataclass(frozen=True)
class DEonFibre:
    """A rough cylinder that conserves energy.

    Parameters
    ----------
    eta : float         index of refraction, inside over outside, 1.0001..3
    alpha_deg : float   tilt of the cuticle scales; the sign is ignored: R always moves towards the
                        root, -20..20 [deg]
    beta_m_deg : float  longitudinal roughness, standard deviation of R, 0.0573..143.2 [deg]
    beta_n_deg : float  azimuthal roughness, standard deviation, 0.0573..143.2 [deg]
    sigma_a : (r,g,b)   absorption; one number stands for three equal ones, 0..1e4
                        [1 / fibre radius]
    orders : int        orders with a lobe of their own: 3 are R, TT, TRT, 3..8
    cone : bool         centre and width of R depend on the azimuth (d'Eon, Marschner and Hanika
                        2014)

    Raises
    ------
    FibreError          names the parameter, its value and the allowed range
    """

    model: ClassVar[str] = "deon"

    eta: float = 1.55
    alpha_deg: float = 3.0
    beta_m_deg: float = 8.0
    beta_n_deg: float = 12.0
    sigma_a: Triple = (0.0, 0.0, 0.0)
    orders: int = 3
    cone: bool = False

    def __post_init__(self) -> None:
        check_parameters(self, RANGES, ("sigma_a",))
        low, high = ORDERS
        whole = isinstance(self.orders, int) and not isinstance(self.orders, bool)
        if not whole or not low <= self.orders <= high:
            raise FibreError(
                f"fibre.orders = {self.orders!r} - allowed is a whole number from {low} to {high}"
            )
        if not isinstance(self.cone, bool):
            raise FibreError(f"fibre.cone = {self.cone!r} - allowed are true and false")

    @property
    def tilt(self) -> float:
        """The tilt that the lobes use, -|alpha| [rad]: negative moves R towards the root."""
        return -abs(math.radians(self.alpha_deg))

    @property
    def beta_m(self) -> float:
        """Longitudinal roughness [rad]."""
        return math.radians(self.beta_m_deg)

    @property
    def beta_n(self) -> float:
        """Azimuthal roughness [rad]."""
        return math.radians(self.beta_n_deg)
