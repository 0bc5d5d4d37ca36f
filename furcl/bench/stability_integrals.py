"""Integrals of the lobes over all directions, for every width: what a lobe sends out must be A_p.

The nodes are laid around the lobe's own centre, in pieces that double in size away from it, so that
a lobe of a thousandth of a radian is resolved as well as a broad one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from furcl.bench.stability_conditioning import reference_attenuation
from furcl.bench.stability_double_cylinder import SUBJECT
from furcl.bench.stability_points import Points
from furcl.bench.stability_row import Row, describe
from furcl.fibre.double_cylinder import layout, reference
from furcl.fibre.double_cylinder.densities import lobe_densities
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference import LOBES
from furcl.fibre.double_cylinder.reference.angles import centre_and_width
from furcl.rendering.probe import Probe

Array = NDArray[np.float64]

BAR = 1e-3
"""Largest error of an integral, relative."""

OFFSET = 0.3

_PHIS = (0.0, 1.0, 2.5, math.pi - 1e-3, math.pi)
"""Azimuths of wi, on which the centre and the width of R depend."""


def integrals(device, betas: Sequence[float], thetas: Sequence[float]) -> list[Row]:
    """One row for each lobe: largest error of its integral over widths and inclinations.

    Parameters
    ----------
    betas : rad         widths, for both directions together and each against a broad other
    thetas : rad        inclinations of wo
    """
    rows = {}
    for beta in betas:
        for beta_m, beta_n in {(beta, beta), (beta, 0.3), (0.3, beta)}:
            fibre = Fibre(
                kappa=0.6, alpha_deg=5.0,
                sigma_ms=1.0, sigma_ma=(0.1, 0.1, 0.1), sigma_ca=(0.1, 0.1, 0.1),
                beta_m_deg=math.degrees(beta_m), beta_n_deg=math.degrees(beta_n),
            )  # fmt: skip
            probe = SUBJECT.probe(fibre, device)
            for theta in thetas:
                for p, lobe in enumerate(probe.lobes[:5]):
                    row = rows.setdefault(lobe, Row("integral", lobe, value=1.0, reference=1.0))
                    _add(row, probe, theta, p)
    return list(rows.values())


def factors(device, betas: Sequence[float], thetas: Sequence[float]) -> list[Row]:
    """Rows of the longitudinal density M and the azimuthal density D of R, TT and TRT, each alone:
    largest error of its integral over widths and inclinations.

    Parameters
    ----------
    betas : rad         widths of both
    thetas : rad        inclinations of wo
    """
    rows = {
        (name, lobe): Row(name, lobe, value=1.0, reference=1.0)
        for name in ("integral of M", "integral of D")
        for lobe in LOBES[:3]
    }
    for beta in betas:
        fibre = Fibre(alpha_deg=5.0, beta_m_deg=math.degrees(beta), beta_n_deg=math.degrees(beta))
        probe = SUBJECT.probe(fibre, device, specialised=False)
        for p, lobe in enumerate(LOBES[:3]):
            nodes = [_one_longitudinal(fibre, p, theta, phi) for theta in thetas for phi in _PHIS]
            at, weight = np.concatenate([x for x, _ in nodes], 1), [w for _, w in nodes]
            turned, w_turned = _pieces([(0.0, beta * math.sqrt(p + 1.0))], -math.pi, 2.0 * math.pi)
            ends = np.cumsum([len(w) for w in weight])[:-1]
            m, _ = lobe_densities(
                probe.memory, probe.material, p, at[0], at[1], at[2], np.zeros(at.shape[1])
            )
            zero = np.zeros(len(turned))
            _, d = lobe_densities(probe.memory, probe.material, p, zero, zero, zero, turned)
            for part, w, (theta, *_) in zip(
                np.split(m, ends), weight, np.split(at, ends, 1), strict=True
            ):
                _score(rows["integral of M", lobe], part, w, probe, float(theta[0]))
            _score(rows["integral of D", lobe], d, w_turned, probe, 0.0)
    return list(rows.values())


def _one_longitudinal(fibre: Fibre, p: int, theta: float, phi: float) -> tuple[Array, Array]:
    """(theta_in, theta_out, phi) of nodes (3, n) over theta_out, and their weights in its sine."""
    mu, width = centre_and_width(fibre, p, np.array([theta]), np.array([phi]))
    inside = float(np.clip(mu[0], -math.pi / 2, math.pi / 2))
    angle, w = _pieces([(inside, float(width[0]))], -math.pi / 2, math.pi)
    return np.stack([np.full_like(angle, theta), angle, np.full_like(angle, phi)]), w * np.cos(
        angle
    )


def _score(row: Row, density, weight: Array, probe: Probe, theta: float) -> None:
    """Add the integral of one density to its row."""
    row.count(np.asarray(density, np.float64)[:, None])
    error = abs(float(np.asarray(density, np.float64) @ weight) - 1.0)
    row.within_bars += len(weight) * (error <= BAR)
    if not error <= row.max_relative:
        row.max_relative, row.excess, row.value = error, error / BAR, 1.0 + error
        at = np.array([[np.sin(theta), np.cos(theta)]])
        wo = np.array([[at[0, 0], at[0, 1], 0.0]])
        row.worst = describe(probe.fibre, Points(at, np.array([OFFSET]), wo, wo), 0)


def _add(row: Row, probe: Probe, theta: float, p: int) -> None:
    nodes = _scattered_nodes if p in (3, 4) else _peak_nodes
    s, c, phi, weight = nodes(probe.fibre, p, theta)
    wo = np.array([[np.sin(theta), np.cos(theta), 0.0]])
    wi = np.stack([s, c * np.cos(phi), c * np.sin(phi)], 1)
    value = probe.evaluate_lobes(wo, wi, np.float32(OFFSET))[0][p]
    energy = reference_attenuation(probe, np.array([OFFSET]), np.array([theta]))[p, 0]
    ratio = (value.astype(np.float64) * weight[:, None]).sum(0) / energy
    error = np.abs(ratio - 1.0)
    row.points += len(s)
    row.within_bars += len(s) * bool((error <= BAR).all())
    if not error.max() <= row.max_relative:
        row.max_relative = float(error.max())
        row.excess = row.max_relative / BAR
        row.value = float(ratio[np.argmax(error)])
        sin_cos = np.array([[np.sin(theta), np.cos(theta)]])
        row.worst = describe(probe.fibre, Points(sin_cos, np.array([OFFSET]), wo, wi[:1]), 0)


def _peak_nodes(fibre: Fibre, p: int, theta: float) -> tuple[Array, Array, Array, Array]:
    """Sine, cosine, azimuth and weight of nodes around lobe p = 0, 1, 2."""
    h = float(np.float32(OFFSET))
    geometry = reference.geometry(fibre, h, theta)
    beta = fibre.beta_n * math.sqrt(p + 1.0)
    # The reflection cone narrows towards phi = pi as well.
    centres = [(float(geometry.Phi(p)), beta)] + ([(math.pi, fibre.beta_m)] if p == 0 else [])
    phi, w_phi = _pieces(centres, float(geometry.Phi(p)) - math.pi, 2.0 * math.pi)
    mu, width = np.broadcast_arrays(*centre_and_width(fibre, p, theta, phi), phi)[:2]
    out = []
    for phi_k, w_k, mu_k, width_k in zip(phi, w_phi, mu, width, strict=True):
        inside = float(np.clip(mu_k, -math.pi / 2, math.pi / 2))
        angle, w = _pieces([(inside, float(width_k))], -math.pi / 2, math.pi)
        cos = np.cos(angle)
        out.append(np.stack([np.sin(angle), cos, np.full_like(angle, phi_k), w_k * w * cos]))
    s, c, turn, weight = np.concatenate(out, axis=1)
    return s, c, turn, weight


def _pieces(centres: list[tuple[float, float]], start: float, length: float, n: int = 8):
    """Gauss-Legendre nodes and weights over [start, start + length]."""
    cuts = [start, start + length]
    for centre, width in centres:
        for turn in (-2.0 * math.pi, 0.0, 2.0 * math.pi):
            steps = width * np.concatenate([[0.0], 1.5 * 2.0 ** np.arange(0, 14)])
            cuts += [centre + turn + step for step in (*steps, *-steps)]
    cuts = np.unique([c for c in cuts if start <= c <= start + length])
    x, w = np.polynomial.legendre.leggauss(n)
    half = np.diff(cuts)[:, None] / 2.0
    return ((cuts[:-1, None] + half) + half * x).ravel(), (half * w).ravel()


def _scattered_nodes(fibre: Fibre, p: int, theta: float) -> tuple[Array, Array, Array, Array]:
    """The centres of the profile's bins, in which it is constant."""
    geometry = reference.geometry(fibre, float(np.float32(OFFSET)), theta)
    turn = geometry.gamma_t - geometry.gamma_i + (p - 3) * (np.pi + 2.0 * geometry.gamma_t)
    n_phi, n_s = layout.PROFILE_PHIS, layout.PROFILE_SINES
    phi = (np.arange(n_phi) + 0.5) * (2.0 * np.pi / n_phi) - np.pi + turn
    s = (np.arange(n_s) + 0.5) * (2.0 / n_s) - 1.0
    grid = np.meshgrid(phi, s)
    phi, s = grid[0].ravel(), grid[1].ravel()
    weight = np.full(s.shape, 2.0 * np.pi / n_phi * 2.0 / n_s)
    nodes = np.stack([s, np.cos(np.arcsin(s)), phi, weight]).astype(np.float64)
    return nodes[0], nodes[1], nodes[2], nodes[3]
