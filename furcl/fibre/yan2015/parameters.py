"""The parameters of a fibre whose medulla has an index of its own."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import RANGES as DOUBLE_CYLINDER_RANGES
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.ranges import number

RANGES = {**DOUBLE_CYLINDER_RANGES, "eta_m": (1.0001, 3.0)}


@dataclass(frozen=True)
class Yan2015Fibre(Fibre):
    """A fibre of cuticle, cortex and a medulla that refracts.

    Parameters
    ----------
    eta_m : float       index of refraction of the medulla over that outside the fibre, 1.0001..3;
                        that of the cortex makes it a double cylinder

    The others are those of `furcl.Fibre`; scattering is as in the model alone.

    Raises
    ------
    FibreError          names the parameter, its value and the allowed range
    """

    model: ClassVar[str] = "yan2015"

    eta_m: float = 1.2

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.is_simulated:
            raise FibreError(
                "fibre.scattering = 'simulated': fibre.model = 'yan2015' has a medulla that "
                "refracts, for which nothing is simulated; allowed is 'model'"
            )
        value = number("eta_m", self.eta_m, RANGES["eta_m"], " (medulla over outside)")
        object.__setattr__(self, "eta_m", value)

    @property
    def cortex(self) -> Fibre:
        """The double cylinder whose medulla has the index of the cortex."""
        names = [field.name for field in dataclasses.fields(Fibre)]
        return Fibre(**{name: getattr(self, name) for name in names})

    @property
    def medulla(self) -> Fibre:
        """A double cylinder with the same medulla: it is asked for by angles inside, which depend
        on the medulla's index."""
        return dataclasses.replace(self.cortex, eta=self.eta_m)
