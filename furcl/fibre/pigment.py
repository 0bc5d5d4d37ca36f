"""Absorption of the cortex from pigment or from a wanted colour.

Pigment gives the cortex absorption ``sigma_ca`` per fibre *radius*. Chiang et al. describe their
coefficients as measured against the fibre's diameter, but their path length for one crossing is ``2
cos(gamma_t) / cos(theta_t)`` on a cylinder of radius one, so that their numbers are per radius;
they are used here unchanged.

Colours are linear with Rec.709 primaries.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from furcl.errors import FibreError

EUMELANIN = (0.419, 0.697, 1.37)
PHEOMELANIN = (0.187, 0.4, 1.05)
Triple = tuple[float, float, float]

BETA_RANGE_DEG = (math.degrees(1e-3), math.degrees(2.5))
"""Roughness of a fibre, 1e-3 to 2.5 rad: narrower, float32 cannot tell the directions of a lobe
apart; broader is uniform."""

COLOUR_RANGE = (1e-6, 1.0)
"""Channels of a colour to reach: black would take absorption without end."""


def sigma_ca_from_melanin(eumelanin: float, pheomelanin: float = 0.0) -> Triple:
    """Cortex absorption of a mixture of the two hair pigments.

    Parameters
    ----------
    eumelanin, pheomelanin : float   concentrations, 0..100 (0.3 blond, 1.3 brown, 8 black)

    Returns
    -------
    (r, g, b)                        absorption per fibre radius, >= 0

    Raises
    ------
    FibreError                       a concentration outside 0..100

    Source: d'Eon et al. 2011; the RGB coefficients are those of Chiang et al. 2016 as used in pbrt.
    """
    for name, value in (("eumelanin", eumelanin), ("pheomelanin", pheomelanin)):
        if not 0.0 <= value <= 100.0:
            raise FibreError(
                f"fibre.{name} = {value} - allowed is 0 to 100 (0.3 is blond, 8 is black) - "
                "give the concentration of the pigment, not a colour"
            )
    r, g, b = (
        float(eumelanin * e + pheomelanin * p) for e, p in zip(EUMELANIN, PHEOMELANIN, strict=True)
    )
    return r, g, b


def sigma_ca_from_colour(colour: Sequence[float], beta_n_deg: float) -> Triple:
    """Cortex absorption for which a thick groom takes about the given colour.

    Parameters
    ----------
    colour : (r, g, b)     wanted multiple-scattering albedo, linear, each 1e-6..1
    beta_n_deg : float     azimuthal roughness [deg], 0.0573..143.2

    Returns
    -------
    (r, g, b)              absorption per fibre radius, >= 0

    Raises
    ------
    FibreError             a channel or the roughness outside its range

    Source: Chiang et al. 2016, the fit of sigma_a to albedo. It was made for fibres without a
    medulla, so a groom with one comes out paler or greyer than asked for. Their roughness parameter
    is taken from ``beta_n_deg`` by equal standard deviation, see `chiang_roughness`.
    """
    values = check_colour(colour)
    scale = albedo_polynomial(chiang_roughness(beta_n_deg))
    r, g, b = ((math.log(c) / scale) ** 2 for c in values)
    return r, g, b


def check_colour(colour: Sequence[float]) -> list[float]:
    """Three channels of a wanted colour.

    Raises
    ------
    FibreError      a channel outside COLOUR_RANGE
    """
    values = [float(c) for c in colour]
    if len(values) != 3 or not all(COLOUR_RANGE[0] <= c <= COLOUR_RANGE[1] for c in values):
        raise FibreError(
            f"fibre.colour = {list(colour)} - allowed are three values from 1e-6 to 1 - "
            "give the linear albedo of the wanted colour (decode sRGB first)"
        )
    return values


def sigma_ca_from_colours(colours: NDArray[np.floating], beta_n_deg: float) -> NDArray[np.floating]:
    """As `sigma_ca_from_colour`, of an array of colours of any shape within COLOUR_RANGE."""
    return (np.log(colours) / albedo_polynomial(chiang_roughness(beta_n_deg))) ** 2


def colour_from_sigma_ca(sigma_ca: Sequence[float], beta_n_deg: float) -> Triple:
    """Inverse of `sigma_ca_from_colour`: (r, g, b) albedo in 0..1 of absorption >= 0 per fibre
    radius."""
    if len(sigma_ca) != 3 or not all(0.0 <= s <= 1e4 for s in sigma_ca):
        raise FibreError(
            f"fibre.sigma_ca = {list(sigma_ca)} - allowed are three values from 0 to 1e4 - "
            "give the absorption per fibre radius"
        )
    scale = albedo_polynomial(chiang_roughness(beta_n_deg))
    r, g, b = (math.exp(-math.sqrt(s) * scale) for s in sigma_ca)
    return r, g, b


def chiang_roughness(beta_n_deg: float) -> float:
    """Azimuthal roughness parameter in 0..1 of Chiang et al. whose logistic has the standard
    deviation ``beta_n_deg``.

    The logistic's scale is sqrt(pi/8) (0.265 b + 1.194 b^2 + 5.372 b^22), its standard deviation
    pi/sqrt(3) times that; it rises with b, so the inverse is found by bisection. ``FibreError`` if
    ``beta_n_deg`` is outside BETA_RANGE_DEG.
    """
    low, high = BETA_RANGE_DEG
    if not low <= beta_n_deg <= high:
        raise FibreError(
            f"fibre.beta_n_deg = {beta_n_deg} - allowed is {low:g} to {high:g} - "
            "give the azimuthal roughness in degrees"
        )
    goal = math.radians(beta_n_deg) * math.sqrt(3.0) / math.pi / math.sqrt(math.pi / 8.0)
    low, high = 0.0, 1.0
    for _ in range(60):
        b = 0.5 * (low + high)
        if 0.265 * b + 1.194 * b**2 + 5.372 * b**22 < goal:
            low = b
        else:
            high = b
    return 0.5 * (low + high)


def albedo_polynomial(b: float) -> float:
    """Of the azimuthal roughness 0..1 of Chiang et al. 2016: -ln(albedo) over sqrt(absorption)."""
    return 5.969 - 0.215 * b + 2.532 * b**2 - 10.73 * b**3 + 5.574 * b**4 + 0.245 * b**5
