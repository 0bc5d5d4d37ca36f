"""The arguments of `furcl.Probe`, checked: numbers, directions, offsets and their limits.

All functions raise FibreError for what they do not take.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from furcl.errors import FibreError
from furcl.values import is_whole, shown

UNIT_TOLERANCE = 1e-3
"""How much the square of a direction's length may differ from 1."""


def unit_directions(name: str, w: ArrayLike) -> np.ndarray:
    """Directions (..., 3) float64 of unit length."""
    w = real_numbers(name, w)
    if w.ndim not in (1, 2) or w.shape[-1] != 3:
        raise FibreError(
            f"probe: {name} has shape {w.shape} - allowed are (n, 3) and (3,) - x is the tangent"
        )
    if not np.all(np.abs((w * w).sum(-1) - 1.0) <= UNIT_TOLERANCE):
        raise FibreError(
            f"probe: {name} holds vectors that are not of length 1 - allowed are unit vectors in "
            f"the fibre's frame - normalise them"
        )
    return w


def real_numbers(name: str, values: ArrayLike) -> np.ndarray:
    """Values as float64."""
    try:
        array = np.asarray(values)
        if array.dtype.kind in "fiu":
            return array.astype(np.float64, copy=False)
        found = f"of type {array.dtype}"
    except (TypeError, ValueError) as error:
        found = f"no array: {error}"
    raise FibreError(f"probe: {name} is {found} - allowed are real numbers")


def check_seed(seed: int) -> None:
    """Refuse what is no seed."""
    if not is_whole(seed) or not 0 <= seed < 1 << 32:
        raise FibreError(f"probe: seed = {shown(seed)} - allowed are 0 to 4294967295")


def uniform_numbers(numbers: ArrayLike, n: int) -> np.ndarray:
    """Numbers (n, 2, 4) float32 of [0, 1); those that round to 1 are the float32 below it."""
    array = real_numbers("numbers", numbers)
    if array.shape != (n, 2, 4):
        raise FibreError(f"probe: numbers has shape {array.shape} - allowed is ({n}, 2, 4)")
    if not np.all((array >= 0.0) & (array < 1.0)):
        raise FibreError(
            f"probe: numbers go from {np.min(array)} to {np.max(array)} - allowed are those of "
            f"[0, 1)"
        )
    return np.minimum(array.astype(np.float32), np.float32(1.0 - 2.0**-24))


def offsets(h: ArrayLike) -> np.ndarray:
    """Offsets as float64, in [-1, 1]."""
    h = real_numbers("h", h)
    if not np.all(np.abs(h) <= 1.0):
        raise FibreError(
            f"probe: h goes from {np.min(h)} to {np.max(h)} - allowed is -1 to 1 - give the offset "
            f"of the ray from the axis over the radius"
        )
    return h


def agreeing(**arrays: np.ndarray) -> list[np.ndarray]:
    """Arrays (n,) or (1,) as arrays (n,)."""
    sizes = {name: np.shape(array) for name, array in arrays.items()}
    n = max((size[0] for size in sizes.values() if len(size) == 1 and size[0] != 1), default=1)
    if all(size in ((n,), (1,)) for size in sizes.values()):
        return list(np.broadcast_arrays(*arrays.values()))
    told = ", ".join(f"{name} {size}" for name, size in sizes.items())
    raise FibreError(f"probe: sizes {told} do not agree - allowed are one size n, or 1")


def limits(within: ArrayLike | None, mode: str, n: int) -> np.ndarray:
    """Limits of h (n, 2) float64 of so many elements.

    Raises
    ------
    FibreError      none where the mode wants some, or some where it has none; limits outside
                    [-1, 1], in the wrong order, or apart where h is known
    """
    if within is None:
        raise FibreError(
            f"probe: within is left out - mode = {mode!r} wants the limits of h - give "
            f"(low, high), or (h, h) for one offset"
        )
    if mode == "far":
        raise FibreError(
            "probe: within is given, and mode = 'far' draws h on the whole width - make the Probe "
            "with mode='multiscale' or 'near'"
        )
    array = real_numbers("within", within)
    if array.shape not in ((2,), (1, 2), (n, 2)):
        raise FibreError(f"probe: within has shape {array.shape} - allowed are (2,) and ({n}, 2)")
    array = np.broadcast_to(array, (n, 2))
    low, high = array[:, 0], array[:, 1]
    apart = mode == "near" and bool(np.any(low != high))
    if apart or not np.all((low >= -1.0) & (low <= high) & (high <= 1.0)):
        raise FibreError(
            f"probe: within goes from {np.min(low)} to {np.max(high)} - allowed are "
            f"-1 <= low <= high <= 1, and low = high in mode 'near'"
        )
    return array


def float4(vectors: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) as float4 (n, 4) float32."""
    out = np.zeros((len(vectors), 4), np.float32)
    out[:, :3] = vectors
    return out
