"""Luminance, the sRGB curve, and colours of other primaries.

Colours are linear with Rec.709 primaries unless a name says sRGB.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

# x and y of red, green, blue and white, as the attribute `chromaticities` of OpenEXR has them.
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
# Headers round: to three digits, or to float32.
CHROMATICITY_TOLERANCE = 1e-3
LARGEST_MIX = 1e3

_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)

LUMINANCE = (0.2126, 0.7152, 0.0722)


def luminance(rgb: ArrayLike) -> NDArray[np.floating]:
    """Rec.709 luminance of linear (..., 3) colours; shape (...)."""
    return np.asarray(rgb) @ np.asarray(LUMINANCE)


def srgb_encode(linear: ArrayLike) -> NDArray[np.floating]:
    """Linear values to sRGB (IEC 61966-2-1), elementwise.

    Values outside 0..1 follow the same curve, mirrored below zero; clip before quantising.
    """
    x = np.asarray(linear, dtype=np.float64)
    size = np.abs(x)
    curve = 1.055 * np.maximum(size, 0.0031308) ** (1.0 / 2.4) - 0.055
    return np.copysign(np.where(size <= 0.0031308, 12.92 * size, curve), x)


def srgb_decode(encoded: ArrayLike) -> NDArray[np.floating]:
    """Inverse of `srgb_encode`."""
    x = np.asarray(encoded, dtype=np.float64)
    size = np.abs(x)
    curve = ((np.maximum(size, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.copysign(np.where(size <= 0.04045, size / 12.92, curve), x)


def to_rec709(chromaticities: Sequence[float]) -> NDArray[np.float64] | None:
    """The matrix (3, 3) that turns linear colours of other primaries into Rec.709.

    White stays white: another white point is adapted to D65 (Bradford; Lindbloom's form, as in
    ICC profiles). Colours outside Rec.709 become negative in a channel.

    Parameters
    ----------
    chromaticities : 8 numbers      x and y of red, green, blue and white

    Returns
    -------
    matrix, or None where the primaries are those of Rec.709 within CHROMATICITY_TOLERANCE

    Raises
    ------
    ValueError      not 8 finite numbers, or such as no mixture of three lights has
    """
    xy = np.asarray(chromaticities, np.float64).ravel()
    if xy.shape != (8,) or not np.isfinite(xy).all():
        raise ValueError("x and y of red, green, blue and white are 8 finite numbers")
    if np.abs(xy - REC709).max() <= CHROMATICITY_TOLERANCE:
        return None
    theirs, ours = _to_xyz(xy), _to_xyz(np.array(REC709))
    cones = _BRADFORD @ theirs.sum(axis=1), _BRADFORD @ ours.sum(axis=1)
    adapt = np.linalg.solve(_BRADFORD, (cones[1] / cones[0])[:, None] * _BRADFORD)
    matrix = np.linalg.solve(ours, adapt @ theirs)
    if not np.isfinite(matrix).all() or np.abs(matrix).max() > LARGEST_MIX:
        raise ValueError("no three lights mix to that white")
    return matrix


def _to_xyz(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """The XYZ of red, green and blue as columns; their sum is white with Y = 1."""
    x, y = xy.reshape(4, 2).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        corners = np.stack([x / y, np.ones(4), (1.0 - x - y) / y])
    if not np.isfinite(corners).all():
        raise ValueError("a y is 0")
    try:
        amounts = np.linalg.solve(corners[:, :3], corners[:, 3])
    except np.linalg.LinAlgError:
        raise ValueError("the primaries lie on one line") from None
    return corners[:, :3] * amounts
