"""Marginal densities: how often a sampler returns each lobe and azimuth, whatever its offset h.

With them a sample of the light is weighed against those of the fibre by its direction alone
(docs/model.md, Light samples). Rows are those of the attenuation tables; the densities are even in
the azimuth.
"""

from __future__ import annotations

import numpy as np

# A lobe that exists has everywhere at least this part of its mean over the azimuth, and of that of
# all lobes: light samples choose lobes by these densities, and must be able to choose each.
FLOOR_OF_LOBE = 1e-3
FLOOR_OF_ALL = 1e-5


def marginals_from_sums(sums: np.ndarray) -> np.ndarray:
    """Densities of lobe and azimuth from the parts of their integrals over h.

    Parameters
    ----------
    sums : (rows, parts, phis, lobes) float     what kernels/prepare/marginals.cl writes; phi from 0
                                                to pi

    Returns
    -------
    (rows, phis, lobes) float32                 [1/rad], >= 0; positive for every lobe chosen
                                                in some row, wherever light is scattered at all
    """
    densities = np.asarray(sums, np.float64).sum(axis=1)
    of_lobe = densities.mean(axis=1, keepdims=True)
    exists = of_lobe.max(axis=0, keepdims=True) > 0.0
    of_all = of_lobe.sum(axis=2, keepdims=True)
    least = np.maximum(FLOOR_OF_LOBE * of_lobe, FLOOR_OF_ALL * of_all)
    return np.where(exists, np.maximum(densities, least), 0.0).astype(np.float32)
