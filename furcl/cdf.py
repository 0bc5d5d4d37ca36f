"""Running sums of probabilities, as kernels search them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def inclusive_cdf(probability: ArrayLike) -> NDArray[np.float32]:
    """Running sums along the last axis: entry i is the chance of 0 to i.

    Summed in float64. From the last positive entry on they are exactly 1, so that a uniform number
    below 1 always finds an entry, and never one of no chance behind it.

    Parameters
    ----------
    probability : (..., n) float    >= 0, with sum 1 along the last axis; a row of zeros gives zeros
                                    but a last entry of 1

    Returns
    -------
    (..., n) float32                never falling, in [0, 1]
    """
    probability = np.asarray(probability)
    cdf = np.minimum(np.cumsum(probability, axis=-1, dtype=np.float64), 1.0).astype(np.float32)
    n = probability.shape[-1]
    last = n - 1 - np.argmax(probability[..., ::-1] > 0.0, axis=-1)
    cdf[np.arange(n) >= last[..., None]] = 1.0
    return cdf
