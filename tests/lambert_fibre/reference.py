"""Float64 reference of the Lambertian fibre, from the normal of the point that the ray meets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """n draws: directions (n, 3), offsets, lobes, weights (n, 3), densities of all three."""

    wi: Array
    h: Array
    lobe: NDArray[np.intp]
    weight: Array
    pdf: Array


def _normal(wo: ArrayLike, h: ArrayLike) -> Array:
    """Unit normals (..., 3) where rays from wo at offsets h meet the fibre."""
    wo, h = np.asarray(wo, np.float64), np.asarray(h, np.float64)
    across = np.hypot(wo[..., 1], wo[..., 2])
    # Along the fibre any plane through it may be called that of wo.
    safe = np.where(across > 0.0, across, 1.0)
    y = np.where(across > 0.0, wo[..., 1] / safe, 1.0)
    z = np.where(across > 0.0, wo[..., 2] / safe, 0.0)
    towards = np.sqrt((1.0 - h) * (1.0 + h))
    return np.stack(np.broadcast_arrays(0.0, towards * y + h * z, towards * z - h * y), axis=-1)


def _density_of_h(fibre, h: Array, sampling: str) -> Array:
    """Per unit of h: even, or in proportion to the attenuation."""
    if sampling == "uniform-h":
        return np.full(np.shape(h), 0.5)
    return (1.0 - fibre.rim * h**2) / (2.0 - 2.0 * fibre.rim / 3.0)


def attenuation(fibre, h: ArrayLike, theta_in: ArrayLike, profiles=None, residual=False):
    """Energy of the lobe at offsets h, {"diffuse": (..., 3)}."""
    h, _ = np.broadcast_arrays(np.asarray(h, np.float64), theta_in)
    return {"diffuse": (1.0 - fibre.rim * h[..., None] ** 2) * np.array(fibre.albedo)}


def direction_pdf(
    fibre, wo: ArrayLike, wi: ArrayLike, h: ArrayLike, profiles=None, *, lobe, sampling
) -> Array:
    """Density (...) of wi [1/sr]: the cosine to the normal over pi."""
    return np.maximum(0.0, (_normal(wo, h) * np.asarray(wi)).sum(axis=-1)) / np.pi


def evaluate(
    fibre, wo: ArrayLike, wi: ArrayLike, h: ArrayLike, profiles=None, lobe=None, residual=False
) -> Array:
    """Value (..., 3) [1/sr], the cosine included."""
    cosine = direction_pdf(fibre, wo, wi, h, lobe=lobe, sampling="uniform-h")
    return attenuation(fibre, h, 0.0)["diffuse"] * cosine[..., None]


def pdf(
    fibre, wo: ArrayLike, wi: ArrayLike, h: ArrayLike, profiles, /, *, sampling, lobe=None,
    residual=False,
) -> Array:  # fmt: skip
    """Density (...) of offset and direction [1/sr per unit of h]."""
    direction = direction_pdf(fibre, wo, wi, h, lobe=lobe, sampling=sampling)
    return _density_of_h(fibre, np.asarray(h, np.float64), sampling) * direction


def sample(fibre, wo: ArrayLike, n=None, profiles=None, *, sampling, rng, residual=False):
    """Draw offsets, by rejection, and directions: the normal and a point of the unit sphere."""
    rng = np.random.default_rng(rng)
    wo = np.atleast_2d(wo) if n is None else np.broadcast_to(wo, (n, 3))
    h, waiting = np.zeros(len(wo)), np.arange(len(wo))
    while len(waiting):
        tried = rng.uniform(-1.0, 1.0, len(waiting))
        rim = 0.0 if sampling == "uniform-h" else fibre.rim
        kept = rng.random(len(waiting)) < 1.0 - rim * tried**2
        h[waiting[kept]] = tried[kept]
        waiting = waiting[~kept]
    sphere = rng.standard_normal((len(wo), 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    wi = _normal(wo, h) + sphere
    wi /= np.linalg.norm(wi, axis=1, keepdims=True)
    density = pdf(fibre, wo, wi, h, None, sampling=sampling)
    weight = 0.5 * evaluate(fibre, wo, wi, h) / density[:, None]
    return Samples(wi, h, np.zeros(len(wo), np.intp), weight, density)


def albedo(fibre, theta: ArrayLike, profiles=None, n=64, residual=False) -> Array:
    """Directional albedo (..., 3): the mean of the attenuation over h."""
    return np.ones((*np.shape(theta), 3)) * np.array(fibre.albedo) * (1.0 - fibre.rim / 3.0)


def lobe_shares(fibre, profiles=None, residual=False) -> dict[str, float]:
    """There is one lobe."""
    return {"diffuse": 1.0}
