"""Independent references for one fibre: vector ray trace, textbook Fresnel, synthetic profiles.

Nothing here uses the model's formulas: the trace knows Snell's law and a cylinder, the reflectances
are sines and tangents in mpmath.
"""

from dataclasses import dataclass, field

import mpmath as mp
import numpy as np


def direction(theta: float, phi: float) -> np.ndarray:
    """Unit vector at inclination theta, azimuth phi; x is the tangent."""
    c = np.cos(theta)
    return np.array([np.sin(theta), c * np.cos(phi), c * np.sin(phi)])


def angles(w: np.ndarray) -> tuple[float, float]:
    """Inclination and azimuth of a vector."""
    return float(np.arctan2(w[0], np.hypot(w[1], w[2]))), float(np.arctan2(w[2], w[1]))


def turn(a: float, b: float = 0.0) -> float:
    """a - b reduced to [-pi, pi]."""
    return float((a - b + np.pi) % (2 * np.pi) - np.pi)


@dataclass
class Trace:
    """A ray through a smooth cylinder of radius 1 with a core of radius kappa."""

    leaving: list[np.ndarray] = field(default_factory=list)
    """Unit directions of R, TT, TRT, TRRT away from the fibre."""
    inside: list[np.ndarray] = field(default_factory=list)
    """Unit directions of flight of the internal stretches."""
    starts: list[np.ndarray] = field(default_factory=list)
    cortex: list[float] = field(default_factory=list)
    core: list[float] = field(default_factory=list)


def _refract(d: np.ndarray, normal: np.ndarray, ratio: float) -> np.ndarray:
    """Snell's law in vectors: ratio = n1/n2, the normal against d."""
    cos = -d @ normal
    out = ratio * d + (ratio * cos - np.sqrt(1 - ratio**2 * (1 - cos**2))) * normal
    return out / np.sqrt(out @ out)


def trace_cylinder(wo: np.ndarray, h: float, eta: float, kappa: float, stretches: int = 3) -> Trace:
    """Follow light that arrives against `wo` and meets the cylinder at offset h."""
    perp = np.array([0.0, -wo[2], wo[1]]) / np.hypot(wo[1], wo[2])
    towards = np.array([0.0, wo[1], wo[2]]) / np.hypot(wo[1], wo[2])
    p = np.sqrt(1 - h * h) * towards - h * perp
    d = -wo
    t = Trace()
    t.leaving.append(d - 2 * (d @ p) * p)
    d = _refract(d, p, 1 / eta)
    for _ in range(stretches):
        across = np.array([0.0, d[1], d[2]])
        a, b = across @ across, across @ p
        length = -2 * b / a
        reach = b * b - a * (1 - kappa**2)
        core = 2 * np.sqrt(reach) / a if reach > 0 else 0.0
        t.inside.append(d)
        t.starts.append(p)
        t.core.append(float(core))
        t.cortex.append(float(length - core))
        p = p + length * d
        normal = -np.array([0.0, p[1], p[2]]) / np.hypot(p[1], p[2])
        p = np.array([p[0], -normal[1], -normal[2]])
        t.leaving.append(_refract(d, normal, eta))
        d = d - 2 * (d @ normal) * normal
    return t


def fresnel_series(eta: float, h: float, theta: float, layers: int) -> tuple[mp.mpf, mp.mpf]:
    """(reflected, passed) of a pile of plates by counting reflections; layers 0 is an interface.

    Interfaces by the laws of sines and tangents, a plate by the series of its inner reflections,
    the pile by adding one plate at a time, every light path between them counted by a series.
    """
    with mp.workdps(60):
        cos = mp.cos(theta) * mp.sqrt((1 - mp.mpf(h)) * (1 + mp.mpf(h)))
        a = mp.acos(cos)
        b = mp.asin(mp.sin(a) / mp.mpf(eta))
        if abs(a) < mp.mpf(10) ** -25:
            both = [((mp.mpf(eta) - 1) / (mp.mpf(eta) + 1)) ** 2] * 2
        else:
            both = [(mp.sin(a - b) / mp.sin(a + b)) ** 2, (mp.tan(a - b) / mp.tan(a + b)) ** 2]
        reflected = mp.mpf(0)
        passed = mp.mpf(0)
        for f in both:
            r, t = f, 1 - f
            if layers:
                inner = mp.nsum(lambda n, f=f: f ** (2 * n), [0, mp.inf])
                r, t = f + (1 - f) ** 2 * f * inner, (1 - f) ** 2 * inner
                plate_r, plate_t = r, t
                for _ in range(layers - 1):
                    inner = mp.nsum(lambda n, x=r * plate_r: x**n, [0, mp.inf])
                    r, t = r + t * t * plate_r * inner, t * plate_t * inner
            reflected += r / 2
            passed += t / 2
        return reflected, passed


@dataclass
class Azimuth:
    """Azimuthal part of synthetic profiles."""

    density: np.ndarray
    absorption: np.ndarray


@dataclass
class Longitudinal:
    """Longitudinal part of synthetic profiles."""

    density: np.ndarray


@dataclass
class SyntheticProfiles:
    """Profiles of a medulla with the sizes of the simulated ones, made up for a test."""

    azimuth: Azimuth
    longitudinal: Longitudinal
    escape: np.ndarray


def flat_profiles(absorption: float = 1.0) -> SyntheticProfiles:
    """Profiles of an isotropic medulla that lets out the same fraction everywhere."""
    return SyntheticProfiles(
        Azimuth(np.full((4, 32, 128), 1 / (2 * np.pi)), np.full((4, 32, 128, 3), absorption)),
        Longitudinal(np.full((16, 2, 64), 0.5)),
        np.full((4, 32, 3), absorption),
    )


def smooth_profiles() -> SyntheticProfiles:
    """Normalised profiles without any symmetry that midpoints in phi and s can integrate."""
    phi = (np.arange(128) + 0.5) / 64 * np.pi - np.pi
    tau, h = np.arange(4)[:, None, None] / 3, np.arange(32)[None, :, None] / 31
    density = 1 + 0.6 * np.cos(phi - 2.5 + h - 0.5 * tau) + 0.25 * np.sin(2 * phi + tau)
    density /= density.sum(-1, keepdims=True) * (2 * np.pi / 128)
    colour = np.array([0.2, 0.5, 0.8])
    absorption = 0.55 + 0.4 * np.sin(phi - h - tau)[..., None] * colour
    s = (np.arange(64) + 0.5) / 32 - 1
    theta, end = np.arange(16)[:, None, None] / 15, np.array([-0.7, 0.5])[None, :, None]
    along = 1 + (end - 0.3 * theta) * s + 0.5 * theta * s * s
    along /= along.sum(-1, keepdims=True) * (2 / 64)
    escape = (density[..., None] * absorption).sum(2) * (2 * np.pi / 128)
    return SyntheticProfiles(Azimuth(density, absorption), Longitudinal(along), escape)


def random_profiles(rng: np.random.Generator) -> SyntheticProfiles:
    """Normalised profiles without any symmetry: every mistake of indexing shows."""
    density = rng.uniform(0.2, 1.0, (4, 32, 128))
    density /= density.sum(-1, keepdims=True) * (2 * np.pi / 128)
    absorption = rng.uniform(0.1, 1.0, (4, 32, 128, 3))
    along = rng.uniform(0.2, 1.0, (16, 2, 64))
    along /= along.sum(-1, keepdims=True) * (2 / 64)
    escape = (density[..., None] * absorption).sum(2) * (2 * np.pi / 128)
    return SyntheticProfiles(Azimuth(density, absorption), Longitudinal(along), escape)
