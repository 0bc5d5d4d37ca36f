"""The parameters of a fibre of Sadeghi et al. 2010, and named sets of them."""

from __future__ import annotations

import dataclasses
import difflib
import math
from typing import Any, ClassVar

import numpy as np

from furcl.errors import FibreError
from furcl.fibre.pigment import BETA_RANGE_DEG
from furcl.fibre.ranges import Range, Triple, check_parameters

_SHIFT: Range = (-45.0, 45.0)
_WIDTH: Range = (BETA_RANGE_DEG[0], 60.0)
_SPREAD: Range = (BETA_RANGE_DEG[0], 90.0)

RANGES: dict[str, Range] = {
    "intensity_r": (0.0, 100.0),
    "intensity_tt": (0.0, 100.0),
    "intensity_trt": (0.0, 100.0),
    "glint": (0.0, 100.0),
    "alpha_r_deg": _SHIFT,
    "alpha_tt_deg": _SHIFT,
    "alpha_trt_deg": _SHIFT,
    "beta_r_deg": _WIDTH,
    "beta_tt_deg": _WIDTH,
    "beta_trt_deg": _WIDTH,
    "gamma_tt_deg": _SPREAD,
    "gamma_glint_deg": _SPREAD,
    "glint_deg": (0.0, 180.0),
}
INTENSITIES = ("intensity_r", "intensity_tt", "intensity_trt")

# As a public shader of the model has them, with R towards the root; intensities are of the look
# alone, and so the preset scales them.
PRESETS: dict[str, dict[str, Any]] = {
    "production": {
        "intensity_r": 1.0,
        "intensity_tt": 4.0,
        "intensity_trt": 0.5,
        "glint": 2.5,
        "alpha_r_deg": -8.0,
        "alpha_tt_deg": 4.0,
        "alpha_trt_deg": 5.0,
        "beta_r_deg": 8.0,
        "beta_tt_deg": 4.0,
        "beta_trt_deg": 15.0,
        "gamma_tt_deg": 10.0,
        "gamma_glint_deg": 10.0,
        "glint_deg": 30.0,
        "normalise": True,
    },
}


@dataclasses.dataclass(frozen=True)
class SadeghiFibre:
    """Lobes whose colour, place and widths are given one by one: made for artists, not for energy.

    Parameters
    ----------
    intensity_r : (r,g,b)       height of R; one number stands for three equal ones, 0..100
    intensity_tt : (r,g,b)      height of TT, 0..100
    intensity_trt : (r,g,b)     height of TRT without its glints, 0..100
    glint : float               height of the glints over that of TRT, 0..100
    alpha_r_deg : float         shift of R along the fibre, in half sums of inclinations; negative
                                is towards the root, -45..45 [deg]
    alpha_tt_deg : float        shift of TT, -45..45 [deg]
    alpha_trt_deg : float       shift of TRT and the glints, -45..45 [deg]
    beta_r_deg : float          width of R along the fibre, standard deviation of the half sum,
                                0.0573..60 [deg]
    beta_tt_deg : float         width of TT, 0.0573..60 [deg]
    beta_trt_deg : float        width of TRT and the glints, 0.0573..60 [deg]
    gamma_tt_deg : float        width of TT around the fibre, 0.0573..90 [deg]
    gamma_glint_deg : float     width of a glint around the fibre, 0.0573..90 [deg]
    glint_deg : float           azimuth of the glints on both sides of the way back, 0..180 [deg]
    normalise : bool            scale all intensities so that the largest albedo is 1

    Raises
    ------
    FibreError      names the parameter, its value and the allowed range
    """

    model: ClassVar[str] = "sadeghi"

    intensity_r: Triple = (0.1, 0.1, 0.1)
    intensity_tt: Triple = (0.3, 0.3, 0.3)
    intensity_trt: Triple = (0.1, 0.1, 0.1)
    glint: float = 2.0
    alpha_r_deg: float = -7.5
    alpha_tt_deg: float = 3.75
    alpha_trt_deg: float = 11.25
    beta_r_deg: float = 7.5
    beta_tt_deg: float = 3.75
    beta_trt_deg: float = 15.0
    gamma_tt_deg: float = 10.0
    gamma_glint_deg: float = 10.0
    glint_deg: float = 35.0
    normalise: bool = False

    def __post_init__(self) -> None:
        check_parameters(self, RANGES, INTENSITIES)
        if not isinstance(self.normalise, bool):
            raise FibreError(f"fibre.normalise = {self.normalise!r} - allowed are true and false")

    @property
    def scale(self) -> float:
        """What all intensities are multiplied with."""
        largest = largest_albedo(self) if self.normalise else 0.0
        return 1.0 / largest if largest > 0.0 else 1.0


def preset(name: str) -> dict[str, Any]:
    """Parameters by name.

    Raises
    ------
    FibreError      unknown name (the nearest one is given)
    """
    if name not in PRESETS:
        near = difflib.get_close_matches(name.lower(), PRESETS, 1, 0.0)
        raise FibreError(
            f"fibre.preset = {name!r} is not known - did you mean {near[0]!r}? - allowed are "
            f"{', '.join(PRESETS)}"
        )
    return PRESETS[name]


def albedo(fibre: SadeghiFibre, theta: np.ndarray) -> np.ndarray:
    """Directional albedo (n, 3) at inclinations (n,) [rad] of the intensities as given, not scaled.

    The integral over the azimuth is an error function, that over the inclination the midpoint rule
    in 2000 steps: within 1e-5 up to 89 degrees
    (tests/test_closed_models.py, against the reference).
    """
    of_tt = _around(fibre.gamma_tt_deg, 180.0)
    lobes = (
        (fibre.intensity_r, fibre.alpha_r_deg, fibre.beta_r_deg, 4.0),
        (fibre.intensity_tt, fibre.alpha_tt_deg, fibre.beta_tt_deg, of_tt),
        (
            fibre.intensity_trt,
            fibre.alpha_trt_deg,
            fibre.beta_trt_deg,
            4.0 + fibre.glint * _around(fibre.gamma_glint_deg, fibre.glint_deg),
        ),
    )  # fmt: skip
    total = np.zeros((len(theta), 3))
    for intensity, alpha_deg, beta_deg, around in lobes:
        alpha, beta = math.radians(alpha_deg), math.radians(beta_deg)
        # theta_h over the lobe, as far as wi is there.
        low = np.maximum((theta - np.pi / 2) / 2.0, alpha - 8.0 * beta)
        high = np.minimum((theta + np.pi / 2) / 2.0, alpha + 8.0 * beta)
        place = (np.arange(2000) + 0.5) / 2000
        step = np.maximum(high - low, 0.0)[:, None]
        theta_h = low[:, None] + step * place
        half_difference = theta_h - theta[:, None]
        bell = np.exp(-0.5 * ((theta_h - alpha) / beta) ** 2)
        # cos^2(theta_o) over cos^2(theta_d), with theta_o = 2 theta_h - theta.
        factor = (np.cos(theta_h + half_difference) / np.cos(half_difference)) ** 2
        along = 2.0 * (bell * factor).mean(1) * step[:, 0]
        total += (along * around)[:, None] * np.array(intensity)
    return total


def _around(spread_deg: float, centre_deg: float) -> float:
    """Integral of a bell of height 1 at a centre of |phi| over the circle."""
    spread, centre = math.radians(spread_deg), math.radians(centre_deg)
    root = math.sqrt(2.0) * spread
    return (
        math.sqrt(2.0 * math.pi)
        * spread
        * (math.erf((math.pi - centre) / root) + math.erf(centre / root))
    )


def largest_albedo(fibre: SadeghiFibre) -> float:
    """The largest albedo of any channel, at inclinations up to 89 degrees, of the intensities as
    given."""
    theta = np.radians(np.linspace(-89.0, 89.0, 179))
    return float(albedo(fibre, theta).max())
