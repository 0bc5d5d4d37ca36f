"""The nearest of some points for each of many others, exactly."""

import numpy as np
from numpy.typing import NDArray

Columns = NDArray[np.float64]

# Pairs that are compared at once: fewer cost more calls, more cost more distances.
PAIRS = 1 << 17
# Rounding changes the difference of two squares of distances, relative to the square of the largest
# coordinates, by less than (14 d^2 + 44 d) 2^-24: 8e-5 for eight axes.
ROUNDING = np.float32(1e-4)


def nearest(guides: NDArray[np.floating], points: NDArray[np.floating]) -> NDArray[np.int64]:
    """Index of the nearest guide of each point; of guides equally far, the first.

    Halves of the points are searched one after the other, each among the guides that can be nearest
    to anything in its box. Distances are compared as squares in float64, summed in the order of the
    axes. Rounding keeps the order of numbers, so the bounds of a box hold for these sums to the bit
    and the result is that of comparing all pairs.

    Parameters
    ----------
    guides : (m, d), m >= 1, d <= 8     finite
    points : (n, d)                     finite

    Returns
    -------
    (n,) int64
    """
    x, g = (np.ascontiguousarray(np.asarray(a, np.float64).T) for a in (points, guides))
    result = np.empty(x.shape[1], np.int64)
    waiting = [(np.arange(len(result)), x, np.arange(g.shape[1]), g)] if len(result) else []
    while waiting:
        own, x, candidates, g = waiting.pop()
        low, high = x.min(axis=1, keepdims=True), x.max(axis=1, keepdims=True)
        # How far guides are from the box, and from the corner of it that is farthest from them.
        below, above = low - g, g - high
        near = _sum_of_squares(np.maximum(np.maximum(below, above), 0.0))
        far = _sum_of_squares(np.maximum(high - g, g - low))
        keep = np.flatnonzero(near <= far.min())
        candidates, g = candidates[keep], g.take(keep, axis=1)
        if len(keep) == 1 or (low == high).all():
            result[own] = candidates[0]
        elif len(own) * len(keep) <= PAIRS:
            result[own] = candidates[_among_all(x, g, 0.5 * (low + high))]
        else:
            order = np.argpartition(x[np.argmax(high - low)], len(own) // 2)
            for half in np.array_split(order, 2):
                waiting.append((own[half], x.take(half, axis=1), candidates, g))
    return result


def _among_all(x: Columns, g: Columns, middle: Columns) -> NDArray[np.int64]:
    """As `nearest`, for columns of (d, n) and (d, m), m >= 2."""
    # |x - g|^2 - |x|^2 in float32 by a product of matrices; what that cannot decide in float64.
    x_near, g_near = ((a - middle).astype(np.float32) for a in (x, g))
    size = np.abs(x_near).max() + np.abs(g_near).max()
    square = (np.float32(-2.0) * x_near).T @ g_near
    square += _sum_of_squares(g_near)
    rows = np.arange(len(square))
    result = square.argmin(axis=1)
    least = square[rows, result]
    square[rows, result] = np.inf
    doubtful = np.flatnonzero(square.min(axis=1) <= least + ROUNDING * size * size)
    exact = _sum_of_squares(x[:, doubtful, None] - g[:, None, :])
    result[doubtful] = exact.argmin(axis=1)
    return result


def _sum_of_squares(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Over the first axis, one after the other; `values` are lost."""
    values *= values
    total = values[0]
    for row in values[1:]:
        total += row
    return total
