"""Brute-force Monte Carlo of light in one smooth fibre, in float64.

A dielectric cylinder of radius 1 with an index-matched core (the medulla) that scatters by
Henyey-Greenstein and absorbs, around it the absorbing cortex. Only Snell's law, Fresnel's equations
for unpolarised light and piles of interfaces, Beer's law and free flights are used: no path
lengths, azimuths or attenuations of the model. Polarisation is averaged at every interface.

The part of the light that has not been scattered is followed exactly: at the surface what leaves is
scored and the rest goes on; in the medulla the unscattered part goes on and the scattered part
starts one random walk, which scores what leaves at each arrival at the surface and goes on with
what is reflected, under Russian roulette.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from furcl.fibre.double_cylinder.parameters import Fibre

CLASSES = ("R", "TT", "TRT", "TRRT+", "TTs", "TRTs", "TRRTs+", "trapped")
"""Energy by path: internal reflections before the first scattering; s: scattered at least once.

trapped: still inside after MAX_EVENTS, guided along the fibre by total reflection."""

S_BINS, PHI_BINS = 32, 36
MAX_EVENTS = 4000
_TRAPPED = 7


@dataclass(frozen=True)
class Truth:
    """What came out, per unit of light that met the fibre.

    energy, error (classes, 3): mean and standard error. direct (classes, 3): of the scattered
    classes what left at the first arrival at the surface after the first scattering. density
    (classes, S_BINS, PHI_BINS): mean of the channels, energy per unit of s and phi, phi in
    [-pi, pi) counted from the side of the light.
    """

    energy: np.ndarray
    error: np.ndarray
    direct: np.ndarray
    density: np.ndarray


def simulate(
    fibre: Fibre,
    theta_i: float,
    photons: int,
    seed: int,
    offsets: tuple[float, float] = (-1.0, 1.0),
    batches: int = 16,
) -> Truth:
    """Light from inclination theta_i [rad] on a smooth fibre, uniform over an interval of offsets.

    Offset h is that of furcl.bcsdf; the default is the whole width of the fibre. The fibre's eta,
    kappa, sigmas, g and layers are used; its cuticle has neither tilt nor roughness.
    Offsets are stratified within each of the batches, which give the standard errors.
    """
    rng = np.random.default_rng(seed)
    shape = (batches, len(CLASSES))
    energy, direct = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    histogram = np.zeros((*shape, S_BINS, PHI_BINS))
    medium = (fibre.eta, fibre.kappa, fibre.sigma_ms, fibre.g, fibre.layers)
    absorb = np.array([fibre.sigma_ca, fibre.sigma_ma])
    per_batch = max(1, photons // batches)
    for b in range(batches):
        _run(rng, theta_i, offsets, medium, absorb, per_batch, energy[b], direct[b], histogram[b])
    cell = 2.0 / S_BINS * 2.0 * math.pi / PHI_BINS
    return Truth(
        energy=energy.mean(0),
        error=energy.std(0, ddof=1) / math.sqrt(batches),
        direct=direct.mean(0),
        density=histogram.mean(0) / cell,
    )


@njit(cache=True)
def _reflectance(cos, n, layers):
    """Reflectance of the cuticle; n: index beyond over index here.

    Fresnel's r for each polarisation; a pile of 2 `layers` interfaces, between which light goes to
    and fro, reflects 2 l r / (1 + (2 l - 1) r). Half a layer is a plain interface.
    """
    sin_sq = (1.0 - cos * cos) / (n * n)
    if sin_sq >= 1.0:
        return 1.0
    cos_t = math.sqrt(1.0 - sin_sq)
    r_s = (cos - n * cos_t) / (cos + n * cos_t)
    r_p = (n * cos - cos_t) / (n * cos + cos_t)
    f_s, f_p = r_s * r_s, r_p * r_p
    both = f_s / (1.0 + (2.0 * layers - 1.0) * f_s) + f_p / (1.0 + (2.0 * layers - 1.0) * f_p)
    return layers * both


@njit(cache=True)
def _score(kind, x, y, z, w, share, energy, histogram):
    """Light w * share leaves in direction (x, y, z)."""
    s_bin = min(int((x + 1.0) * 0.5 * S_BINS), S_BINS - 1)
    phi = math.atan2(z, y)
    phi_bin = min(int((phi + math.pi) / (2.0 * math.pi) * PHI_BINS), PHI_BINS - 1)
    mean = 0.0
    for c in range(3):
        energy[kind, c] += w[c] * share
        mean += w[c] * share / 3.0
    histogram[kind, s_bin, phi_bin] += mean


@njit(cache=True)
def _chords(p, d, kappa):
    """Distance to the surface, and where the core begins and ends on the way (equal: missed)."""
    a = max(d[1] * d[1] + d[2] * d[2], 1e-30)
    b = p[0] * d[1] + p[1] * d[2]
    r_sq = p[0] * p[0] + p[1] * p[1]
    length = (-b + math.sqrt(max(b * b - a * (r_sq - 1.0), 0.0))) / a
    reach = b * b - a * (r_sq - kappa * kappa)
    if reach <= 0.0:
        return length, 0.0, 0.0
    root = math.sqrt(reach)
    begin, end = max((-b - root) / a, 0.0), min((-b + root) / a, length)
    if end <= begin:
        return length, 0.0, 0.0
    return length, begin, end


@njit(cache=True)
def _advance(p, d, length):
    p[0] += d[1] * length
    p[1] += d[2] * length


@njit(cache=True)
def _meet_surface(p, d, eta, layers, out):
    """At the surface from inside: the refracted direction into `out`, d reflected; reflectance."""
    r = math.sqrt(p[0] * p[0] + p[1] * p[1])
    p[0] /= r
    p[1] /= r
    cos = max(d[1] * p[0] + d[2] * p[1], 0.0)
    reflected = _reflectance(cos, 1.0 / eta, layers)
    if reflected < 1.0:
        bend = math.sqrt(max(1.0 - eta * eta * (1.0 - cos * cos), 0.0)) - eta * cos
        out[0] = eta * d[0]
        out[1] = eta * d[1] + bend * p[0]
        out[2] = eta * d[2] + bend * p[1]
    d[1] -= 2.0 * cos * p[0]
    d[2] -= 2.0 * cos * p[1]
    return reflected


@njit(cache=True)
def _deflect(rng, d, g):
    """Henyey-Greenstein."""
    u = rng.random()
    if abs(g) < 1e-4:
        cos = 2.0 * u - 1.0
    else:
        q = (1.0 - g * g) / (1.0 - g + 2.0 * g * u)
        cos = (1.0 + g * g - q * q) / (2.0 * g)
    cos = min(max(cos, -1.0), 1.0)
    sin = math.sqrt((1.0 - cos) * (1.0 + cos))
    turn = 2.0 * math.pi * rng.random()
    x, y, z = d[0], d[1], d[2]
    if abs(x) < 0.9:
        n = math.sqrt(y * y + z * z)
        ax, ay, az = 0.0, z / n, -y / n
    else:
        n = math.sqrt(x * x + z * z)
        ax, ay, az = -z / n, 0.0, x / n
    bx, by, bz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
    ca, cb = sin * math.cos(turn), sin * math.sin(turn)
    d[0] = cos * x + ca * ax + cb * bx
    d[1] = cos * y + ca * ay + cb * by
    d[2] = cos * z + ca * az + cb * bz
    n = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    d /= n


@njit(cache=True)
def _walk(rng, kind, p, d, w, medium, absorb, out, energy, direct, histogram):
    """From a first collision at p of light that flew along d."""
    eta, kappa, sigma_ms, g, layers = medium
    _deflect(rng, d, g)
    first = True
    full = w.max()
    for _ in range(MAX_EVENTS):
        if w.max() < 0.02 * full:
            if rng.random() >= 0.1:
                return
            w /= 0.1
            if w.max() == 0.0:
                return
        length, begin, end = _chords(p, d, kappa)
        flight = -math.log(1.0 - rng.random()) / sigma_ms
        if flight < end - begin:
            for c in range(3):
                w[c] *= math.exp(-absorb[0, c] * begin - absorb[1, c] * flight)
            _advance(p, d, begin + flight)
            _deflect(rng, d, g)
            continue
        for c in range(3):
            w[c] *= math.exp(-absorb[0, c] * (length - end + begin) - absorb[1, c] * (end - begin))
        _advance(p, d, length)
        reflected = _meet_surface(p, d, eta, layers, out)
        if reflected < 1.0:
            _score(kind, out[0], out[1], out[2], w, 1.0 - reflected, energy, histogram)
            if first:
                for c in range(3):
                    direct[kind, c] += w[c] * (1.0 - reflected)
        first = False
        w *= reflected
    for c in range(3):
        energy[_TRAPPED, c] += w[c]


@njit(cache=True)
def _run(rng, theta_i, offsets, medium, absorb, photons, energy, direct, histogram):
    """One batch; adds energies per photon."""
    eta, kappa, sigma_ms, _, layers = medium
    d, out = np.empty(3), np.empty(3)
    p, w = np.empty(2), np.empty(3)
    d_walk, p_walk, w_walk = np.empty(3), np.empty(2), np.empty(3)
    for i in range(photons):
        h = offsets[0] + (offsets[1] - offsets[0]) * (i + rng.random()) / photons
        p[0], p[1] = math.sqrt((1.0 - h) * (1.0 + h)), -h
        d[0], d[1], d[2] = -math.sin(theta_i), -math.cos(theta_i), 0.0
        w[:] = 1.0 / photons
        cos = -(d[1] * p[0] + d[2] * p[1])
        reflected = _reflectance(cos, eta, layers)
        _score(0, d[0], d[1] + 2.0 * cos * p[0], d[2] + 2.0 * cos * p[1], w, reflected,
               energy, histogram)  # fmt: skip
        bend = cos / eta - math.sqrt(1.0 - (1.0 - cos * cos) / (eta * eta))
        d /= eta
        d[1] += bend * p[0]
        d[2] += bend * p[1]
        w *= 1.0 - reflected
        for order in range(MAX_EVENTS):
            length, begin, end = _chords(p, d, kappa)
            core = end - begin
            met = -math.expm1(-sigma_ms * core)
            if met > 0.0:
                flight = min(-math.log1p(-rng.random() * met) / sigma_ms, core)
                for c in range(3):
                    w_walk[c] = w[c] * met * math.exp(
                        -absorb[0, c] * begin - absorb[1, c] * flight
                    )  # fmt: skip
                p_walk[:] = p
                d_walk[:] = d
                _advance(p_walk, d_walk, begin + flight)
                _walk(rng, 4 + min(order, 2), p_walk, d_walk, w_walk, medium, absorb, out,
                      energy, direct, histogram)  # fmt: skip
            for c in range(3):
                w[c] *= (1.0 - met) * math.exp(
                    -absorb[0, c] * (length - core) - absorb[1, c] * core
                )  # fmt: skip
            _advance(p, d, length)
            reflected = _meet_surface(p, d, eta, layers, out)
            _score(1 + min(order, 2), out[0], out[1], out[2], w, 1.0 - reflected,
                   energy, histogram)  # fmt: skip
            w *= reflected
            if w.max() * photons < 1e-9:
                break
