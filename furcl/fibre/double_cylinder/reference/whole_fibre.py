"""Look-ups in the tables of simulated scattering, and draws from them.

Nodes over |sin(theta)| of the known direction turned by the tilt, uniform from 0 to 1, and over the
offset in the medulla, h_j = sin(pi/2 j/(n-1)); linear in |sin(theta)| and in asin(h) between them,
constant in each cell of phi over [-pi, pi) and of s over [-1, 1]. What is interpolated is the
energy that leaves in each channel.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.angles import wrap
from furcl.fibre.double_cylinder.reference.draws import pick, place_in_row
from furcl.fibre.double_cylinder.reference.profiles import Tables
from furcl.fibre.double_cylinder.reference.scattered import neighbours

Array = NDArray[np.float64]
Weighted = tuple[Array, NDArray[np.intp], NDArray[np.intp]]


def _rows(fibre: Fibre, tables: Tables, theta_i: Array, h_t: Array) -> Iterator[Weighted]:
    """(weight, i, j) of the four rows around the inclination and |h_t| / kappa."""
    n_theta, n_h = tables.density.shape[:2]
    along = np.abs(np.sin(theta_i - fibre.tilt)) * (n_theta - 1)
    offset = np.arcsin(np.minimum(np.abs(h_t) / fibre.kappa, 1.0)) / (np.pi / 2) * (n_h - 1)
    for w_i, i in neighbours(along, n_theta):
        for w_j, j in neighbours(offset, n_h):
            yield w_i * w_j, i, j


def _escape_of(tables: Tables, i: NDArray[np.intp], j: NDArray[np.intp]) -> Array:
    """Escaping share (..., 3) of rows."""
    if tables.escape is None:
        return np.ones((*i.shape, 3))
    return np.broadcast_to(tables.escape[i, j].astype(np.float64), (*i.shape, 3))


def escape(fibre: Fibre, tables: Tables, theta_i: Array, h_t: Array) -> Array:
    """Share (..., 3) of the scattered light that leaves the fibre."""
    total = np.zeros((*np.shape(h_t), 3))
    for w, i, j in _rows(fibre, tables, theta_i, h_t):
        total += w[..., None] * _escape_of(tables, i, j)
    return total


def leaving(
    fibre: Fibre, tables: Tables, theta_i: Array, h_t: Array, phi_q: Array, s_o: Array
) -> tuple[Array, Array]:
    """What leaves at (phi_q, s_o) [1/sr]: its density (...), mean of the channels, and (..., 3) the
    energy of each channel over what was scattered. The integral of the second is `escape`."""
    n_phi, n_s = tables.density.shape[2:]
    phi = wrap(np.where(h_t < 0.0, -phi_q, phi_q))
    column = ((phi + np.pi) / (2.0 * np.pi) * n_phi).astype(np.intp) % n_phi
    s = np.where(theta_i - fibre.tilt < 0.0, -s_o, s_o)
    along = np.clip(((s + 1.0) * 0.5 * n_s).astype(np.intp), 0, n_s - 1)
    energy = np.zeros((*column.shape, 3))
    mean, whole = np.zeros(column.shape), np.zeros(column.shape)
    for w, i, j in _rows(fibre, tables, theta_i, h_t):
        row = w * _escape_of(tables, i, j).mean(-1)
        here = row * tables.density[i, j, column, along]
        colour = 1.0 if tables.colours is None else tables.colours[i, j, column, along]
        energy += here[..., None] * colour
        mean += here
        whole += row
    return np.divide(mean, whole, out=np.zeros_like(mean), where=whole > 0.0), energy


def draw(
    fibre: Fibre, tables: Tables, theta_i: Array, h_t: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """phi_q [rad] and s (...) with the density of `leaving`: one of the four rows is taken by its
    weight times its energy, then a cell, and any place in it."""
    n_h, n_phi, n_s = tables.density.shape[1:]
    weights, i, j = zip(*_rows(fibre, tables, theta_i, h_t), strict=True)
    energy = np.stack(
        [w * _escape_of(tables, *at).mean(-1) for w, *at in zip(weights, i, j, strict=True)]
    )
    total = energy.sum(0)
    which = pick(np.divide(energy, total, out=np.stack(weights).copy(), where=total > 0.0), rng)
    row = np.choose(which, i) * n_h + np.choose(which, j)
    at, inside = place_in_row(tables.density.reshape(-1, n_phi * n_s), row, rng)
    column, along = np.divmod(at, n_s)
    phi = (column + rng.random(at.shape)) * (2.0 * np.pi / n_phi) - np.pi
    s = (along + inside) * (2.0 / n_s) - 1.0
    return np.where(h_t < 0.0, -phi, phi), np.where(theta_i - fibre.tilt < 0.0, -s, s)
