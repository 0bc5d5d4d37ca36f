"""Models whose scattering function knows no offset under the stability sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_cylinder import CylinderSubject
from furcl.fibre.marschner.azimuth import LOBES, caustic, energy_of_offsets
from furcl.fibre.marschner.model import MODEL as MARSCHNER
from furcl.fibre.marschner.parameters import RANGES as MARSCHNER_RANGES
from furcl.fibre.marschner.parameters import MarschnerFibre
from furcl.fibre.marschner.reference import attenuation as marschner_attenuation
from furcl.fibre.sadeghi.model import MODEL as SADEGHI
from furcl.fibre.sadeghi.parameters import RANGES as SADEGHI_RANGES
from furcl.fibre.sadeghi.parameters import SadeghiFibre
from furcl.fibre.sadeghi.reference import attenuation as sadeghi_attenuation
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

_HEIGHTS = (0.0, 1e-3, 1.0, 100.0, (0.1, 1.0, 10.0))
_SHIFTS = (-45.0, -7.5, 0.0, 7.5, 45.0)
_WIDTHS = tuple(math.degrees(b) for b in (1e-3, 3e-3, 0.03, 0.25, 1.0))
_SPREADS = tuple(math.degrees(b) for b in (1e-3, 3e-3, 0.03, 0.25, 1.5))

# Values of every parameter that lie at the end of its range or where a formula changes.
SADEGHI_EDGES: dict[str, Sequence[Any]] = {
    **dict.fromkeys(("intensity_r", "intensity_tt", "intensity_trt"), _HEIGHTS),
    "glint": (0.0, 1e-3, 2.0, 100.0),
    **dict.fromkeys(("alpha_r_deg", "alpha_tt_deg", "alpha_trt_deg"), _SHIFTS),
    **dict.fromkeys(("beta_r_deg", "beta_tt_deg", "beta_trt_deg"), _WIDTHS),
    **dict.fromkeys(("gamma_tt_deg", "gamma_glint_deg"), _SPREADS),
    "glint_deg": (0.0, 35.0, 90.0, 180.0),
    "normalise": (False, True),
}


class SadeghiSubject(CylinderSubject):
    """Fibres of Sadeghi's model."""

    # Many widths off a narrow lobe rounding an inclination moves a bell: 1.4e-4 was measured.
    weight_bars: Mapping[str, float] = dict.fromkeys(("R", "TT", "TRT", "glint"), 1e-3)
    base: Mapping[str, Any] = {}
    logarithmic = ("intensity_r", "intensity_tt", "intensity_trt")

    def most_energy(self, fibre: SadeghiFibre) -> float:
        """Nothing bounds it: what the heights and widths give."""
        lobes = sadeghi_attenuation(fibre, 0.0, 0.0)
        return max(float(np.sum(list(lobes.values()), axis=0).max()), 1e-30)

    def direction_factors(self, probe: Probe) -> Array:
        """exp(-x^2 / 2) (1 + x^2) is below 1.22 along and around, 2 cos^2(theta_o) /
        cos^2(theta_d) below 8, and angles of the Cauchy densities span at most a half turn."""
        bell = 2.0 * math.exp(-0.5)
        along = 8.0 * math.pi * bell
        return np.array([along / math.sqrt(2.0 * math.pi), along * bell / 2.0] * 2)

    def index(self, fibre: SadeghiFibre) -> float:
        """The model knows none."""
        return 1.5


MARSCHNER_EDGES: dict[str, Sequence[Any]] = {
    "eta": (1.1, 1.33, 1.55, 2.0, 3.0),
    "alpha_deg": (-20.0, 0.0, 1e-4, 20.0),
    "beta_deg": (0.12, 0.5, 2.0, 7.5, 20.0, 45.0),
    "sigma_a": (0.0, 1e-8, 1.0, 50.0, 1e4, (1e-2, 1.0, 1e4)),
    "glint": (0.0, 1e-3, 1.0, 10.0),
    "caustic_width_deg": (1.0, 15.0, 30.0),
    "caustic_fade": (0.01, 0.3, 2.0),
    "caustic_limit": (0.01, 0.5, 1.0),
    "norm": ("unit", "published"),
}


class MarschnerSubject(CylinderSubject):
    """Fibres of Marschner's model, circular ones."""

    # Beside a caustic the slope of the azimuth goes as a root of the distance: rounding the azimuth
    # moves the weight, most where the glints begin to have all of it.
    weight_bars: Mapping[str, float] = {"TRT": 1.0}

    def most_energy(self, fibre: MarschnerFibre) -> float:
        """Of all orders at most 1, and of the glints what they are said to have: each stands for
        TRT at one offset, at most 4/27, over at most the whole width, times k_G."""
        return 1.0 + 2.0 * fibre.glint * fibre.caustic_limit * 4.0 / 27.0

    def direction_factors(self, probe: Probe) -> Array:
        """A_p at theta_d over its bin's mean, at most 2 where it rises or falls in it; the energies
        at theta_d over those that the lobe is chosen by, at theta; and cos^2(theta_o) /
        cos^2(theta_d), below 4. theta_h is within 6 standard deviations."""
        fibre, factors = probe.fibre, []
        theta = np.radians(np.linspace(-90.0, 90.0, 61))
        chosen = marschner_attenuation(fibre, 0.0, theta)
        for name, (shift, width) in zip(LOBES, fibre.lobes, strict=True):
            out = np.clip(
                2.0 * (shift + width * np.linspace(-6.0, 6.0, 49)) - theta[:, None],
                -np.pi / 2,
                np.pi / 2,
            )
            half = np.abs(out - theta[:, None]) / 2.0
            energy = energy_of_offsets(fibre, name, half, 48).mean(-1)
            if name == "TRT":
                energy = energy + caustic(fibre, half).energy.mean(-1)
            cosines = (np.cos(out) / np.maximum(np.cos(half), 1e-6)) ** 2
            share = np.maximum(chosen[name].mean(-1), 1e-35)[:, None]
            factors.append(4.0 * float((fibre.twice_norm * cosines * energy / share).max()))
        return np.array(factors)


MARSCHNER_SUBJECT = MarschnerSubject(
    MARSCHNER, MarschnerFibre, MARSCHNER_EDGES, MARSCHNER_RANGES | {}
)
SADEGHI_SUBJECT = SadeghiSubject(SADEGHI, SadeghiFibre, SADEGHI_EDGES, SADEGHI_RANGES)
