"""Look-ups in the medulla's scattering profiles, and draws from them.

Azimuth: nodes over cos(theta_t), uniform from 1 down to sqrt(1 - 1/eta^2), and over the offset in
the medulla, h_j = sin(pi/2 j/(n-1)); linear in cos(theta_t) and in asin(h) between them, constant
in each bin of phi over [-pi, pi). Longitudinal: nodes over |theta_i| uniform 0..pi/2, a back (phi =
0) and a front (phi = pi) row each, constant in each bin of s over [-1, 1].
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.angles import wrap
from furcl.fibre.double_cylinder.reference.draws import pick, place_in_row
from furcl.fibre.double_cylinder.reference.profiles import Profiles

Array = NDArray[np.float64]


def neighbours(coordinate: Array, nodes: int) -> Iterator[tuple[Array, NDArray[np.intp]]]:
    """(weight, index) of the two nodes around a coordinate in 0..nodes-1."""
    x = np.clip(coordinate, 0.0, nodes - 1.0)
    low = np.minimum(x.astype(np.intp), nodes - 2)
    yield 1.0 - (x - low), low
    yield x - low, low + 1


def rows_around(fibre: Fibre, table: NDArray[np.floating], cos_theta_t: Array, h_t: Array):
    """(weight, i, j) of the four rows around (cos_theta_t, |h_t| / kappa)."""
    n_tau, n_h = table.shape[:2]
    lowest = np.sqrt((fibre.eta - 1.0) * (fibre.eta + 1.0)) / fibre.eta
    tau = (1.0 - cos_theta_t) / (1.0 - lowest) * (n_tau - 1)
    offset = np.arcsin(np.minimum(np.abs(h_t) / fibre.kappa, 1.0)) / (np.pi / 2) * (n_h - 1)
    for w_i, i in neighbours(tau, n_tau):
        for w_j, j in neighbours(offset, n_h):
            yield w_i * w_j, i, j


def escape(fibre: Fibre, profiles: Profiles, cos_theta_t: Array, h_t: Array) -> Array:
    """Fraction (..., 3) of the scattered light that the medulla does not absorb."""
    if profiles.escape is None:
        return np.ones((*np.shape(h_t), 3))
    total = np.zeros((*np.shape(h_t), 3))
    for w, i, j in rows_around(fibre, profiles.escape, cos_theta_t, h_t):
        total += w[..., None] * profiles.escape[i, j]
    return total


def azimuthal(
    fibre: Fibre, profiles: Profiles, cos_theta_t: Array, h_t: Array, phi_q: Array
) -> tuple[Array, Array]:
    """Density Dhat (...) [1/rad] at phi_q for offset h_t, and (..., 3) the same carrying the
    medulla's absorption.

    phi_q counts from the ray's own direction of arrival; a negative offset is the mirror image of a
    positive one. The second is interpolated as a product, so that its integral over phi_q is
    `escape` exactly.
    """
    table, carried = profiles.azimuth.density, profiles.azimuth.absorption
    n_phi = table.shape[2]
    phi = wrap(np.where(h_t < 0.0, -phi_q, phi_q))
    bins = ((phi + np.pi) / (2.0 * np.pi) * n_phi).astype(np.intp) % n_phi
    density = np.zeros(np.shape(bins))
    energy = np.zeros((*np.shape(bins), 3))
    for w, i, j in rows_around(fibre, table, cos_theta_t, h_t):
        row = w * table[i, j, bins]
        density += row
        energy += row[..., None] * (1.0 if carried is None else carried[i, j, bins])
    return density, energy


def longitudinal(fibre: Fibre, profiles: Profiles, theta_i: Array, s_o: Array, phi: Array) -> Array:
    """Density M^s (...) per unit of s, integral 1 over [-1, 1].

    The back and front rows are blended linearly in the outer azimuth |phi|/pi. Only the in-angle is
    shifted by the tilt: shifting the out-angle as well would not preserve s, and so lose energy.
    """
    table = profiles.longitudinal.density
    n_theta, _, n_s = table.shape
    theta = theta_i - fibre.tilt
    s = np.where(theta < 0.0, -s_o, s_o)
    bins = np.clip(((s + 1.0) * 0.5 * n_s).astype(np.intp), 0, n_s - 1)
    front = np.abs(wrap(phi)) / np.pi
    total = np.zeros(np.shape(bins))
    for w, i in neighbours(np.abs(theta) / (np.pi / 2) * (n_theta - 1), n_theta):
        total += w * ((1.0 - front) * table[i, 0, bins] + front * table[i, 1, bins])
    return total


def draw_azimuth(
    fibre: Fibre, profiles: Profiles, cos_theta_t: Array, h_t: Array, rng: np.random.Generator
) -> Array:
    """phi_q (...) [rad] in [-pi, pi] with the density that `azimuthal` gives.

    One of the four rows around is taken with its weight, which is to draw from the interpolated
    density.
    """
    table = profiles.azimuth.density
    n_h, n_phi = table.shape[1:]
    weights, i, j = zip(*rows_around(fibre, table, cos_theta_t, h_t), strict=True)
    which = pick(weights, rng)
    row = np.choose(which, i) * n_h + np.choose(which, j)
    at, inside = place_in_row(table.reshape(-1, n_phi), row, rng)
    phi = (at + inside) * (2.0 * np.pi / n_phi) - np.pi
    return np.where(h_t < 0.0, -phi, phi)


def draw_sine(
    fibre: Fibre, profiles: Profiles, theta_i: Array, phi: Array, rng: np.random.Generator
) -> Array:
    """s (...) in [-1, 1] with the density that `longitudinal` gives at azimuth phi: a row of theta
    by its weight, then back or front."""
    table = profiles.longitudinal.density
    n_theta, _, n_s = table.shape
    theta = theta_i - fibre.tilt
    node = np.abs(theta) / (np.pi / 2) * (n_theta - 1)
    weights, i = zip(*neighbours(node, n_theta), strict=True)
    row = np.choose(pick(weights, rng), i)
    front = rng.random(phi.shape) < np.abs(wrap(phi)) / np.pi
    at, inside = place_in_row(table.reshape(-1, n_s), 2 * row + front, rng)
    s = (at + inside) * (2.0 / n_s) - 1.0
    return np.where(theta < 0.0, -s, s)
