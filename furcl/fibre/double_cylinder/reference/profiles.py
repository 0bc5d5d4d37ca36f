"""What the reference takes of a medulla: its scattering profiles, or the word that leaves them out.

The profiles that a device simulates (`furcl.Probe(fibre).material.profiles`) have this shape;
others may.
"""

import reprlib
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.parameters import Fibre


class Azimuth(Protocol):
    """Azimuthal profile.

    density (T, H, P) per radian, integral 1; absorption (T, H, P, 3 or 1), mean transmittance of a
    bin, or None for 1.
    """

    @property
    def density(self) -> NDArray[np.floating]: ...
    @property
    def absorption(self) -> NDArray[np.floating] | None: ...


class Longitudinal(Protocol):
    """Longitudinal profile: density (Theta, 2, S) per unit of s, integral 1."""

    @property
    def density(self) -> NDArray[np.floating]: ...


class Profiles(Protocol):
    """Profiles of one medulla.

    escape (T, H, 3 or 1) is the integral of density times absorption, or None for 1.
    """

    @property
    def azimuth(self) -> Azimuth: ...
    @property
    def longitudinal(self) -> Longitudinal: ...
    @property
    def escape(self) -> NDArray[np.floating] | None: ...


class Tables(Protocol):
    """Tables of simulated scattering of one material.

    density (T, H, P, S) per unit of phi and s, integral 1; escape (T, H, 3 or 1), the share that
    leaves of each channel, or None for 1; colours (T, H, P, S, 3), each channel over their mean, or
    None for 1.
    """

    @property
    def density(self) -> NDArray[np.floating]: ...
    @property
    def escape(self) -> NDArray[np.floating] | None: ...
    @property
    def colours(self) -> NDArray[np.floating] | None: ...


class Unscattered:
    """The type of UNSCATTERED."""

    def __repr__(self) -> str:
        return "bcsdf.UNSCATTERED"


UNSCATTERED: Final = Unscattered()
"""In place of profiles: light that the medulla scatters is left out. TTs and TRTs are zero, and the
residual lobe is what was never scattered."""

MedullaData: TypeAlias = Profiles | Tables | Unscattered | None
"""What the public functions take; None only for a fibre whose medulla scatters nothing."""


def profiles_in_use(fibre: Fibre, profiles: MedullaData) -> Any:
    """The profiles to look up, or the tables of a fibre whose scattering is simulated; None where
    nothing scatters, or what scatters is left out.

    Raises
    ------
    FibreError      no profiles of a medulla that scatters, or something else in their place
    """
    left_out = profiles is None or isinstance(profiles, Unscattered)
    parts = ("density", "escape") if fibre.is_simulated else ("azimuth", "longitudinal")
    if not left_out and not all(hasattr(profiles, part) for part in parts):
        raise FibreError(
            f"bcsdf: profiles = {reprlib.repr(profiles)} - allowed are the profiles of a medulla "
            f"for scattering = {fibre.scattering!r}, "
            "bcsdf.UNSCATTERED or None - pass probe.material.profiles; a lobe is named by lobe="
        )
    if not fibre.has_medulla:
        return None
    if profiles is None:
        raise FibreError(
            f"bcsdf: no profiles, but the medulla scatters (kappa = {fibre.kappa:g}, sigma_ms = "
            f"{fibre.sigma_ms:g}) - allowed are its profiles or bcsdf.UNSCATTERED - pass "
            "furcl.Probe(fibre).material.profiles, or bcsdf.UNSCATTERED to leave out all light "
            "that the medulla scatters"
        )
    return None if left_out else profiles
