"""The choice of lobe and offset h: its joint density q(lobe, h), and draws from it.

Sources: Shibaike and Iwasaki, sections 4.2 to 4.4 and equation 4, for the lobe by the integral of
A_p and h by the lobe's 200 bins; d'Eon et al. 2013 and Yan et al. 2017 for h uniform.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.draws import Indices, pick, place_in_row
from furcl.fibre.double_cylinder.reference.energy import bin_means
from furcl.fibre.double_cylinder.reference.optics import LOBES, RESIDUAL, attenuation, checked
from furcl.fibre.double_cylinder.reference.pairs import sampling_name
from furcl.fibre.double_cylinder.reference.profiles import MedullaData

Array = NDArray[np.float64]

BINS = 100
"""Bins over |h|, A_p being even: the paper's 200 over h."""

NODES = 16
"""Gauss-Legendre nodes in each bin. Light nearer to a bin's ends than any of them, 1e-4 of its
size, does not count."""


def joint_densities(
    fibre: Fibre,
    theta: ArrayLike,
    h: ArrayLike,
    profiles: MedullaData = None,
    *,
    sampling: str,
    residual: bool = False,
) -> dict[str, Array]:
    """Density q(lobe, h) with which a sampler chooses lobe and offset.

    Parameters
    ----------
    theta : (...)       inclination of wo [rad], [-pi/2, pi/2]
    h : (...)           offset, [-1, 1]
    profiles            as for `attenuation`
    sampling : str      as for `sample`
    residual : bool     with the lobe "residual"

    Returns
    -------
    lobe name -> (...) float64      per unit of h: the sum over lobes has integral 1 over h in
                                    [-1, 1]; all 0 where no lobe carries light

    Raises
    ------
    FibreError          theta or h outside its range, unknown sampling, no profiles of a medulla
                        that scatters

    One table is made for each distinct |theta|: many different inclinations take long.
    """
    h, theta = checked(h, theta)
    choice = choice_of(sampling, fibre, theta.ravel(), profiles, residual)
    q = choice.densities(h.ravel())
    names = lobe_names(fibre, residual)
    return {name: row.reshape(h.shape) for name, row in zip(names, q, strict=True)}


def lobe_names(fibre: Fibre, residual: bool) -> Sequence[str]:
    """The lobes among which is chosen, in the order of their indices."""
    return (*LOBES, RESIDUAL) if residual or fibre.is_simulated else LOBES


class UniformOffset:
    """h uniform, then the lobe in proportion to A_p(h), mean of the channels."""

    def __init__(self, fibre: Fibre, theta: Array, profiles: MedullaData, residual: bool) -> None:
        self._arguments = fibre, theta, profiles, residual

    def densities(self, h: Array) -> Array:
        """q (lobes, n) at offsets h (n,)."""
        fibre, theta, profiles, residual = self._arguments
        lobes = attenuation(fibre, h, theta, profiles, residual)
        share = np.stack([a.mean(-1) for a in lobes.values()])
        total = share.sum(0)
        return 0.5 * np.divide(share, total, out=np.zeros_like(share), where=total > 0.0)

    def draw(self, rng: np.random.Generator) -> tuple[Indices, Array]:
        """Lobes and offsets (n,); the number of lobes where none carries light."""
        h = rng.uniform(-1.0, 1.0, self._arguments[1].shape)
        q = self.densities(h)
        lobe = pick(2.0 * q, rng)
        return np.where(q.sum(0) > 0.0, lobe, len(q)), h


class BinnedOffset:
    """The lobe by the integral of its attenuation, then h by the lobe's bins, uniform inside."""

    def __init__(self, fibre: Fibre, theta: Array, profiles: MedullaData, residual: bool) -> None:
        inclinations, self._row = np.unique(np.abs(theta), return_inverse=True)
        means = [bin_means(fibre, t, profiles, BINS, NODES, residual) for t in inclinations]
        self._means = np.reshape(means, (-1, len(lobe_names(fibre, residual)), BINS))
        # Half the integral over h, of all lobes: the albedo.
        self._albedo = self._means.mean(2).sum(1)

    def densities(self, h: Array) -> Array:
        """q (lobes, n) at offsets h (n,)."""
        bins = np.minimum((np.abs(h) * BINS).astype(np.intp), BINS - 1)
        means, albedo = self._means[self._row, :, bins].T, self._albedo[self._row]
        return 0.5 * np.divide(means, albedo, out=np.zeros_like(means), where=albedo > 0.0)

    def draw(self, rng: np.random.Generator) -> tuple[Indices, Array]:
        """Lobes and offsets (n,); the number of lobes where none carries light."""
        alive = self._albedo > 0.0
        rows = np.where(alive[:, None, None], self._means, 1.0).reshape(len(alive), -1)
        at, inside = place_in_row(rows, self._row, rng)
        lobe, bins = np.divmod(at, BINS)
        size = np.minimum((bins + inside) / BINS, 1.0)
        h = np.where(rng.random(size.shape) < 0.5, -size, size)
        return np.where(alive[self._row], lobe, self._means.shape[1]), h


def choice_of(
    sampling: str, fibre: Fibre, theta: Array, profiles: MedullaData, residual: bool
) -> UniformOffset | BinnedOffset:
    """The choice of a sampler at inclinations theta (n,)."""
    kind = UniformOffset if sampling_name(sampling) == "uniform-h" else BinnedOffset
    return kind(fibre, theta, profiles, residual)
