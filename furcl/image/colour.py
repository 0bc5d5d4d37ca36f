"""Luminance and the sRGB curve.

Colours are linear with Rec.709 primaries unless a name says sRGB.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
