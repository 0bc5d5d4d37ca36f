"""Energies of the lobes by quadrature over the offset h."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.optics import LOBES, attenuation
from furcl.fibre.double_cylinder.reference.profiles import MedullaData

Array = NDArray[np.float64]


def medulla_edge(fibre: Fibre, theta: float) -> float:
    """Offset |h| <= 1 up to which rays at inclination theta meet the medulla."""
    cos = np.cos(theta)
    n_t = np.sqrt((fibre.eta - 1.0) * (fibre.eta + 1.0) + cos * cos)
    return 1.0 if fibre.kappa * n_t >= cos else float(fibre.kappa * n_t / cos)


def nodes_over_h(
    fibre: Fibre, theta: float, bins: int, n: int
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Gauss-Legendre nodes over h in [0, 1] in even bins, cut once more at the medulla's edge.

    In each piece h runs as sin^2 of the variable: the square roots at h = 1 and at the edge become
    smooth. Returns nodes and weights (pieces, n) and the bin of each piece; the weights sum to 1.
    """
    cuts = np.union1d(np.arange(bins + 1) / bins, medulla_edge(fibre, theta))
    x, w = np.polynomial.legendre.leggauss(n)
    angle = np.pi / 4 * (x + 1.0)
    low, size = cuts[:-1, None], np.diff(cuts)[:, None]
    h = low + size * np.sin(angle) ** 2
    weight = size * np.sin(2.0 * angle) * w * np.pi / 4
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    return np.minimum(h, 1.0), weight, (middle * bins).astype(np.intp)


def lobe_albedos(
    fibre: Fibre,
    theta: ArrayLike,
    profiles: MedullaData = None,
    n: int = 64,
    residual: bool = False,
) -> dict[str, Array]:
    """Directional albedo of each lobe: 1/2 the integral of A_p over h in [-1, 1].

    Parameters
    ----------
    theta : (...)     inclination of the known direction [rad], [-pi/2, pi/2]
    profiles          as for `attenuation`
    n : int           Gauss-Legendre nodes in each piece; the error is below 1e-9 with 64
                      (test_bcsdf_energy.py::test_quadrature)
    residual : bool   adds the lobe "residual"

    Returns
    -------
    lobe name -> (..., 3) float64, in [0, 1]

    Raises
    ------
    FibreError        theta outside its range; no profiles of a medulla that scatters
    """
    theta = np.asarray(theta, np.float64)
    rows: dict[str, list[Array]] = {}
    for angle in theta.ravel():
        h, w, _ = nodes_over_h(fibre, float(angle), 1, n)
        for name, a in attenuation(fibre, h, angle, profiles, residual).items():
            rows.setdefault(name, []).append(np.einsum("pn,pnc->c", w, a))
    return {name: np.reshape(row, (*theta.shape, 3)) for name, row in rows.items()}


def albedo(
    fibre: Fibre,
    theta: ArrayLike,
    profiles: MedullaData = None,
    n: int = 64,
    residual: bool = False,
) -> Array:
    """Directional albedo (..., 3): the radiance of the fibre under a constant white environment.
    See `lobe_albedos`."""
    lobes = lobe_albedos(fibre, theta, profiles, n, residual)
    return np.sum(list(lobes.values()), axis=0)


def lobe_shares(
    fibre: Fibre, profiles: MedullaData = None, residual: bool = False
) -> dict[str, float]:
    """Share of each lobe in what isotropically oriented fibres return; they sum to 1.

    At each inclination the lobe albedos, mean of the channels, are scaled to sum 1: the chance with
    which `attenuation-cdf` picks the lobe. These are averaged with weight cos^2(theta), orientation
    times visible width. Arguments and errors as for `lobe_albedos`.
    """
    x, w = np.polynomial.legendre.leggauss(48)
    theta = np.pi / 4 * (x + 1.0)
    lobes = lobe_albedos(fibre, theta, profiles, residual=residual)
    energy = np.stack([albedo.mean(-1) for albedo in lobes.values()])
    weight = w * np.cos(theta) ** 2
    total = energy.sum(0)
    shares = np.divide(energy, total, out=np.zeros_like(energy), where=total > 0.0)
    shares = shares @ weight / weight.sum()
    return {name: float(share) for name, share in zip(lobes, shares, strict=True)}


def bin_means(
    fibre: Fibre, theta: float, profiles: MedullaData, bins: int, n: int, residual: bool = False
) -> Array:
    """Mean of the scalar A_p (mean of the channels) over each of `bins` even bins of |h|.

    n Gauss-Legendre nodes in each bin, twice that where the medulla's edge falls in it.

    Returns
    -------
    (lobes, bins) float64
    """
    h, w, which = nodes_over_h(fibre, theta, bins, n)
    lobes = attenuation(fibre, h, theta, profiles, residual)
    table = np.zeros((len(lobes), bins))
    for row, a in zip(table, lobes.values(), strict=True):
        np.add.at(row, which, (w * a.mean(-1)).sum(-1) * bins)
    return table


def attenuation_tables(
    fibre: Fibre,
    profiles: MedullaData = None,
    rows: int = 32,
    bins: int = 100,
    n: int = 8,
    residual: bool = False,
) -> Array:
    """`bin_means` at many inclinations: what the device's tables should hold before bins are
    lifted.

    Rows are nodes over |theta| from 0 to pi/2 inclusive, even in sqrt(cos(theta)): row r is at
    arccos((1 - r / (rows - 1))^2). Bins cut |h| from 0 to 1 evenly.

    Returns
    -------
    (rows, lobes, bins) float64     five lobes, or six with the residual
    """
    table = np.zeros((rows, len(LOBES) + (residual or fibre.is_simulated), bins))
    for row, theta in enumerate(np.arccos(np.linspace(1.0, 0.0, rows) ** 2)):
        table[row] = bin_means(fibre, float(theta), profiles, bins, n, residual)
    return table
