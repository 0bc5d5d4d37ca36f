"""Float64 reference of the Lambertian fibre, from the normal of the point that the ray meets."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

LOBES = ("diffuse",)


def attenuation(
    fibre, h: ArrayLike, theta: ArrayLike, profiles: None = None, *, residual: bool = False
) -> dict[str, Array]:
    """Energy of the lobe at offsets h and inclinations theta of wo, (..., 3)."""
    h, _ = np.broadcast_arrays(np.asarray(h, np.float64), theta)
    return {"diffuse": (1.0 - fibre.rim * h[..., None] ** 2) * np.array(fibre.albedo)}


def direction_pdf(
    fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    h: ArrayLike,
    profiles: None = None,
    *,
    lobe: str | int = "diffuse",
    sampling: str = "full-cdf",
) -> Array:
    """Density (...) of wi [1/sr]: the cosine to the normal over pi."""
    wo, wi, h = np.asarray(wo, np.float64), np.asarray(wi, np.float64), np.asarray(h, np.float64)
    across = np.hypot(wo[..., 1], wo[..., 2])
    # Along the fibre any plane through it may be called that of wo.
    safe = np.where(across > 0.0, across, 1.0)
    y = np.where(across > 0.0, wo[..., 1] / safe, 1.0)
    z = np.where(across > 0.0, wo[..., 2] / safe, 0.0)
    towards = np.sqrt((1.0 - h) * (1.0 + h))
    normal = np.stack(np.broadcast_arrays(0.0, towards * y + h * z, towards * z - h * y), axis=-1)
    return np.maximum(0.0, (normal * wi).sum(axis=-1)) / np.pi


def evaluate(
    fibre,
    wo: ArrayLike,
    wi: ArrayLike,
    h: ArrayLike,
    profiles: None = None,
    *,
    lobe: str | int | None = None,
    residual: bool = False,
) -> Array:
    """Value (..., 3) [1/sr], the cosine included."""
    return attenuation(fibre, h, 0.0)["diffuse"] * direction_pdf(fibre, wo, wi, h)[..., None]


def albedo(fibre, theta: ArrayLike, profiles: None = None, *, residual: bool = False) -> Array:
    """Directional albedo (..., 3): the mean of the attenuation over h."""
    return np.ones((*np.shape(theta), 3)) * np.array(fibre.albedo) * (1.0 - fibre.rim / 3.0)
