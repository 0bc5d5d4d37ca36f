"""Whether fibres are as wide as fibres are, compared with their groom."""

from __future__ import annotations

import numpy as np

from furcl.groom.curves import Curves

#: Shares of the groom's size between which the width of a fibre is not questioned.
THICKEST, THINNEST = 1e-2, 1e-5
#: What a width of hair and fur usually is of its groom.
USUAL = 1.0 / 2500.0
#: Factor on the widths -> what they may be.
_UNITS = {
    1e-3: "millimetres beside lengths in metres",
    1e-2: "centimetres beside lengths in metres",
    0.1: "millimetres beside lengths in centimetres",
    10.0: "centimetres beside lengths in millimetres",
    100.0: "metres beside lengths in centimetres",
    1e3: "metres beside lengths in millimetres",
}


def question(curves: Curves) -> str:
    """What to ask about widths that are no fibres'; "" of others.

    The median width is compared with the largest side of the box around the points.
    """
    size = float((curves.points.max(axis=0).astype(float) - curves.points.min(axis=0)).max())
    width = 2.0 * float(np.median(curves.radii))
    if size <= 0.0 or THINNEST * size <= width <= THICKEST * size:
        return ""
    much, than = ("thicker", "1/100") if width > THICKEST * size else ("thinner", "1/100,000")
    factor = min(_UNITS, key=lambda f: abs(np.log(f * width / (USUAL * size))))
    return (
        f"fibres are {width:.3g} wide in a groom of {size:.3g}: {much} than {than} of it. Are "
        f"widths {_UNITS[factor]}? --radius-scale {factor:g} (curves.radius_scale in a scene) "
        f"makes them {factor * width:.3g}"
    )
