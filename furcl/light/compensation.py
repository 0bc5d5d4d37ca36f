"""Densities of light samples that leave to the samples of materials what these find well.

Light samples of density p_L are weighed against the material's own by the balance heuristic
(docs/model.md, Light samples), so they need not follow the light: where it is dim the material
finds it at little noise, and light samples that go there are missed where it is bright. Taking a
part of the mean radiance off before the density is made sends them there (Karlik et al. 2019).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Of the mean radiance over all directions; and what is left at least of each part's own power, so
# that a light sample alone weighs no more than 16 times as much as without. From 0.5 to 1 the three
# scenes of the paper differ by less than 10 % in six lights (docs/notebook.md).
SHARE = 0.75
LEAST = 1.0 / 16.0

Array = NDArray[np.float64]


def compensated_power(power: Array, solid_angles: Array, total: float | None = None) -> Array:
    """What chances of sampling the parts of a light around the scene are to be proportional to.

    Parameters
    ----------
    power : (...)           of each part, its luminance times solid angle, >= 0
    solid_angles : (...)    of each part, broadcast to `power` [sr]; where a part lies in front of
                            another, its power is what it adds
    total : float           power of all parts, where `power` has some of them

    Returns
    -------
    (...)       >= LEAST power, and <= power
    """
    mean = (power.sum() if total is None else total) / (4.0 * np.pi)
    return np.maximum(power - SHARE * mean * solid_angles, LEAST * power)
