"""Draws of a row of a table, and of a place in the row."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def pick(weights: ArrayLike, rng: np.random.Generator) -> Indices:
    """Which of k weights (k, ...), that sum to 1 at each place, (...)."""
    below = np.cumsum(np.asarray(weights)[:-1], axis=0)
    return (rng.random(below.shape[1:]) >= below).sum(axis=0)


def place_in_row(
    table: NDArray[np.floating], row: Indices, rng: np.random.Generator
) -> tuple[Indices, Array]:
    """Bins in proportion to the row's entries, and uniform places [0, 1) in them.

    Parameters
    ----------
    table : (rows, bins)    >= 0, with a positive sum in each row
    row : (...)             rows to draw from
    """
    n_bins = table.shape[1]
    cdf = np.cumsum(table, axis=1, dtype=np.float64)
    # One rising sequence for all rows: row r climbs from r to r + 1.
    rising = (cdf / cdf[:, -1:] + np.arange(len(cdf))[:, None]).ravel()
    at = np.searchsorted(rising, row + rng.random(row.shape), side="right")
    return np.minimum(at - row * n_bins, n_bins - 1), rng.random(row.shape)
