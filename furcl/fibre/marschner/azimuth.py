"""Azimuthal scattering of Marschner et al. 2003 in float64.

N_p(phi) = sum over the offsets h = sin(gamma) with Phi_p(gamma) = phi of A_p(h) / (2 |dPhi_p/dh|),
and of TRT the glints in place of its caustics. Offsets are found by bisection.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.double_cylinder.reference.angles import wrapped_gaussian
from furcl.fibre.marschner.parameters import MarschnerFibre

Array = NDArray[np.float64]

LOBES = ("R", "TT", "TRT")
BINS = 16
LEAST_MEAN = 1e-20
LEAST_SLOPE = 1e-4


def wrapped(angle: Array) -> Array:
    """An angle in [-pi, pi]."""
    return angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi))


def eta_prime(eta: Array, theta: Array) -> Array:
    """The index of refraction across the fibre, at an inclination inside (-pi/2, pi/2)."""
    return np.sqrt(eta**2 - np.sin(theta) ** 2) / np.maximum(np.cos(theta), 1e-15)


def attenuation(
    fibre: MarschnerFibre, name: str, gamma: Array, theta: Array, eta: Array | None = None
) -> Array:
    """A_p (..., 3) at h = sin(gamma)."""
    eta = np.asarray(fibre.eta) if eta is None else eta
    f, passed = _fresnel(eta, np.cos(gamma) * np.cos(theta))
    if name == "R":
        return np.asarray(f)[..., None] * np.ones(3)
    cos_t = np.sqrt(eta**2 - np.sin(theta) ** 2) / eta
    chord = 2.0 * np.cos(np.arcsin(np.sin(gamma) / eta_prime(eta, theta))) / cos_t
    once = np.exp(-chord[..., None] * np.asarray(fibre.sigma_a))
    passed, f = np.asarray(passed)[..., None], np.asarray(f)[..., None]
    return passed**2 * once if name == "TT" else passed**2 * f * once**2


def _fresnel(eta: Array, cosine: Array) -> tuple[Array, Array]:
    """Reflectance and transmittance at a cosine of incidence: at normal inclination the offset
    whose cosine that is."""
    inside = np.sqrt(eta**2 - 1.0 + cosine**2) / eta
    pairs = ((cosine, eta * inside), (eta * cosine, inside))
    reflected = sum(((a - b) / (a + b)) ** 2 for a, b in pairs)
    passed = sum(4.0 * a * b / (a + b) ** 2 for a, b in pairs)
    return 0.5 * np.asarray(reflected), 0.5 * np.asarray(passed)


def azimuth(p: int, gamma: Array, index: Array) -> Array:
    """Phi_p less p pi."""
    return 2.0 * p * np.arcsin(np.sin(gamma) / index) - 2.0 * gamma


def slope(p: int, gamma: Array, index: Array) -> Array:
    """dPhi_p / dgamma."""
    return 2.0 * p * np.cos(gamma) / np.sqrt(index**2 - np.sin(gamma) ** 2) - 2.0


class Caustic(NamedTuple):
    """Where TRT turns back at inclinations (...), and the glints there."""

    fade: Array
    gamma: Array
    phi: Array
    energy: Array
    """(..., 3) of both glints."""


def caustic(fibre: MarschnerFibre, theta: Array, eta: Array | None = None) -> Caustic:
    """The caustics at inclinations theta (...)."""
    eta = np.asarray(fibre.eta) if eta is None else eta
    index = eta_prime(eta, theta)
    turns = index < 2.0
    above = np.clip((index - 2.0) / fibre.caustic_fade, 0.0, 1.0)
    fade = 1.0 - above**2 * (3.0 - 2.0 * above)
    gamma = np.where(turns, np.arcsin(np.sqrt(np.maximum(4.0 - index**2, 0.0) / 3.0)), 0.0)
    phi = np.where(turns, azimuth(2, gamma, index), 0.0)
    bend = np.abs(-4.0 * np.sin(gamma) * (index**2 - 1.0) / (index**2 - np.sin(gamma) ** 2) ** 1.5)
    width = np.deg2rad(fibre.caustic_width_deg)
    wide = 2.0 * np.cos(gamma) * np.sqrt(2.0 * width / np.maximum(bend, 1e-12))
    reach = np.where(turns, np.minimum(fibre.caustic_limit, wide), fibre.caustic_limit)
    each = fade * fibre.glint * reach
    return Caustic(
        fade, gamma, phi, 2.0 * each[..., None] * attenuation(fibre, "TRT", gamma, theta, eta)
    )


def offsets(p: int, phi: Array, index: Array) -> list[tuple[Array, NDArray[np.bool_]]]:
    """gamma of every branch that leaves at phi, and where there is one.

    On each branch Phi_p(gamma) rises or falls: by bisection, and two steps of Newton's method at
    the end.
    """
    target = wrapped(phi - p * np.pi)
    turn = np.zeros_like(index)
    if p == 2:
        turn = np.arcsin(np.sqrt(np.clip((4.0 - index**2) / 3.0, 0.0, 1.0)))
        turn = np.where(index < 2.0, turn, 0.0)
    end = np.full_like(index, np.pi / 2)
    branches = [(-end, end)] if p < 2 else [(-end, -turn), (-turn, turn), (turn, end)]
    found = []
    for number, (low, high) in enumerate(branches):
        at_low, at_high = (azimuth(p, g, index) for g in (low, high))
        there = (target - at_low) * (target - at_high) <= 0.0
        if p == 2:
            # Without a caustic the middle is empty, and both others meet at 0: counted once.
            there &= (index < 2.0) if number == 1 else True
            there &= (target != 0.0) | (index < 2.0) | (number == 0)
        rises = at_high > at_low
        for _ in range(30):
            middle = (low + high) / 2.0
            too_high = (azimuth(p, middle, index) > target) == rises
            low, high = np.where(too_high, low, middle), np.where(too_high, middle, high)
        gamma = (low + high) / 2.0
        for _ in range(2):
            steep = slope(p, gamma, index)
            step = (azimuth(p, gamma, index) - target) / np.where(steep == 0.0, np.inf, steep)
            gamma = np.clip(gamma - step, low, high)
        found.append((gamma, there))
    return found


def _edges() -> Array:
    u = np.arange(BINS + 1) / BINS
    return np.pi / 2 * u * (2.0 - u)


def binned(fibre: MarschnerFibre, name: str, theta: Array) -> tuple[Array, Array]:
    """Mean of A_p over h (..., 3) by bins that count with the mean of their ends; and the densities
    (..., BINS) of |h| in them, by the channels' mean."""
    edges = _edges()
    ends = attenuation(fibre, name, edges, np.asarray(theta)[..., None])
    mean = (ends[..., :-1, :] + ends[..., 1:, :]) / 2.0
    width = np.diff(np.sin(edges))
    share = mean.mean(-1) + LEAST_MEAN
    return np.einsum("...kc,k->...c", mean, width), share / (share @ width)[..., None]


def _offset_density(
    fibre: MarschnerFibre, name: str, gamma: Array, theta: Array, by_attenuation: bool
) -> Array:
    if not by_attenuation:
        return np.ones(np.broadcast_shapes(np.shape(gamma), np.shape(theta)))
    size = np.abs(gamma)
    at = np.clip(np.searchsorted(_edges(), size, side="right") - 1, 0, BINS - 1)
    return np.take_along_axis(binned(fibre, name, theta)[1], at[..., None], -1)[..., 0]


def _sum(fibre, name, phi, theta, eta, weigh) -> Array:
    """Sum over the offsets that leave at phi of half of |dh / dPhi| times `weigh(gamma)`."""
    phi, theta = np.broadcast_arrays(np.asarray(phi, np.float64), np.asarray(theta, np.float64))
    p = LOBES.index(name)
    index = eta_prime(np.asarray(fibre.eta) if eta is None else eta, theta)
    total = 0.0
    for gamma, there in offsets(p, phi, index):
        falls = np.abs(slope(p, gamma, index))
        there = there & (falls > LEAST_SLOPE)
        jacobian = np.where(there, 0.5 * np.cos(gamma) / np.where(there, falls, 1.0), 0.0)
        weight = weigh(gamma)
        total = (
            total + jacobian.reshape(jacobian.shape + (1,) * (weight.ndim - gamma.ndim)) * weight
        )
    return np.asarray(total)


def left_of_caustics(fibre: MarschnerFibre, phi: Array, c: Caustic) -> Array:
    """What is left of the offsets' light beside the caustics (...), 0..1."""
    width = np.deg2rad(fibre.caustic_width_deg)
    left = 1.0
    for side in (-1.0, 1.0):
        left = left * (1.0 - c.fade * np.exp(-0.5 * (wrapped(phi - side * c.phi) / width) ** 2))
    return np.asarray(left)


def glint_density(fibre: MarschnerFibre, phi: Array, c: Caustic) -> Array:
    """Density of azimuths of the two glints (...) [1/rad]."""
    width = np.deg2rad(fibre.caustic_width_deg)
    one, other = (wrapped_gaussian(wrapped(phi - s * c.phi), width) for s in (-1.0, 1.0))
    return 0.5 * (one + other)


def far_field(
    fibre: MarschnerFibre, name: str, phi: Array, theta: Array, eta: Array | None = None
) -> Array:
    """N_p(phi) (..., 3) [1/rad] at inclinations theta >= 0; eta: of an ellipse, at each azimuth."""
    n = _sum(
        fibre, name, phi, theta, eta, lambda gamma: attenuation(fibre, name, gamma, theta, eta)
    )
    if name != "TRT":
        return n
    c = caustic(fibre, theta, eta)
    left, glints = left_of_caustics(fibre, phi, c), glint_density(fibre, phi, c)
    return n * left[..., None] + c.energy * glints[..., None]


def density(
    fibre: MarschnerFibre, name: str, phi: Array, theta: Array, by_attenuation: bool
) -> Array:
    """Density (...) [1/rad] of azimuths drawn by an offset, or from the glints."""
    smooth = _sum(
        fibre, name, phi, theta, None,
        lambda gamma: _offset_density(fibre, name, gamma, theta, by_attenuation),
    )  # fmt: skip
    if name != "TRT":
        return smooth
    c, chance = caustic(fibre, theta), glint_chance(fibre, theta)
    return (1.0 - chance) * smooth + chance * glint_density(fibre, phi, c)


def glint_chance(fibre: MarschnerFibre, theta: Array) -> Array:
    """How often TRT is drawn from its glints (...)."""
    glints = caustic(fibre, theta).energy.mean(-1)
    return glints / (glints + binned(fibre, "TRT", theta)[0].mean(-1) + LEAST_MEAN)


def draw(
    fibre: MarschnerFibre, name: str, theta: Array, rng: np.random.Generator, by_attenuation: bool
) -> Array:
    """Azimuths (n,) [rad] of that density."""
    n, p = len(theta), LOBES.index(name)
    if by_attenuation:
        edges = np.sin(_edges())
        cdf = np.cumsum(binned(fibre, name, theta)[1] * np.diff(edges), axis=-1)
        at = np.minimum((rng.random(n)[:, None] > cdf).sum(-1), BINS - 1)
        h = rng.uniform(edges[at], edges[at + 1]) * rng.choice([-1.0, 1.0], n)
    else:
        h = rng.uniform(-1.0, 1.0, n)
    index = eta_prime(np.asarray(fibre.eta), theta)
    phi = azimuth(p, np.arcsin(np.clip(h, -1.0, 1.0)), index) + p * np.pi
    if name == "TRT":
        width = np.deg2rad(fibre.caustic_width_deg)
        side = rng.choice([-1.0, 1.0], n) * caustic(fibre, theta).phi
        glint = side + width * rng.standard_normal(n)
        phi = np.where(rng.random(n) < glint_chance(fibre, theta), glint, phi)
    return phi


def energy_of_offsets(fibre: MarschnerFibre, name: str, theta: Array, nodes: int = 200) -> Array:
    """Mean of A_p over h (..., 3), nearly exact."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    gamma = np.pi / 4 * (x + 1.0)
    a = attenuation(fibre, name, gamma, np.asarray(theta)[..., None])
    return np.einsum("...kc,k->...c", a, w * np.pi / 4 * np.cos(gamma))


def integral(fibre: MarschnerFibre, name: str, theta: Array) -> Array:
    """Of N_p over the azimuth (..., 3): half of the mean of A_p over the width, with what is taken
    out at the caustics, and the glints."""
    if name != "TRT":
        return energy_of_offsets(fibre, name, theta, 64)
    c = caustic(fibre, theta)
    x, w = np.polynomial.legendre.leggauss(96)
    gamma = np.pi / 2 * x
    index = eta_prime(np.asarray(fibre.eta), theta)[..., None]
    phi = azimuth(2, gamma, index)
    each = Caustic(c.fade[..., None], c.gamma[..., None], c.phi[..., None], c.energy)
    left = left_of_caustics(fibre, phi, each)[..., None]
    a = attenuation(fibre, name, np.abs(gamma), theta[..., None]) * left
    return np.einsum("...kc,k->...c", a, 0.5 * w * np.pi / 2 * np.cos(gamma)) + c.energy
