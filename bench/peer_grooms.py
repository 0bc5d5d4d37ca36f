"""The grooms on which other renderers were measured: bench/peers.py renders them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.groom.curves import Curves

# Strands and points of each: ten thousand hairs, a hundred thousand fibres of fur.
GROOMS = {"hair10k": (10_000, 16), "fur100k": (100_000, 8)}
SEED = 1

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
COMBED = np.array([0.5, -0.6, -0.7])


def grow(name: str, n_strands: int | None = None) -> Curves:
    """A groom on a unit sphere, `hair10k` or `fur100k`, thinned if a number of strands is given."""
    strands, points = GROOMS[name]
    strands = n_strands or strands
    rng = np.random.default_rng(SEED)
    make, radius = (_hair, 0.4) if name.startswith("hair") else (_fur, 0.9)
    positions, radii = make(strands, points, rng, radius / np.sqrt(strands))
    return Curves.from_arrays(
        positions.reshape(-1, 3).astype(np.float32),
        radii.reshape(-1).astype(np.float32),
        np.arange(strands + 1, dtype=np.uint32) * points,
    )


def facts(name: str) -> dict[str, Any]:
    """Tables of the scene around a groom that do not depend on how fibres are modelled."""
    hair = name.startswith("hair")
    return {
        "camera": {
            "origin": [0.0, -4.5, 1.2],
            "target": [0.0, 0.0, -0.15 if hair else 0.0],
            "up": [0.0, 0.0, 1.0],
            "vfov_deg": 54.0 if hair else 36.0,
        },
        "environment": {"kind": "constant", "radiance": [0.4, 0.4, 0.4]},
        "body": {"centre": [0.0, 0.0, 0.0], "radii": [1.0, 1.0, 1.0], "albedo": [0.1, 0.08, 0.06]},
    }


def _hair(
    n: int, k: int, rng: np.random.Generator, radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (n, k, 3) and radii (n, k): straight to wavy hair that droops from the upper part."""
    root = _roots(n, rng, -0.35)
    tangent, side = _frames(root)
    length = 0.9 + 0.5 * rng.random(n)
    droop = 0.35 + 0.35 * rng.random(n)
    depth = 0.05 * rng.random(n) ** 2  # most strands are nearly straight
    rate = 4.0 + 6.0 * rng.random(n)
    phase = 2.0 * np.pi * rng.random(n)
    lean = 0.25 * rng.standard_normal((n, 2))
    s = np.linspace(0.0, 1.0, k)[None, :, None]
    along = _unit(root + lean[:, :1] * tangent + lean[:, 1:] * side)
    points = root[:, None] + s * (length[:, None, None] * along[:, None])
    down = np.array([0.0, 0.0, -1.0])
    points = points + down * (droop[:, None, None] * length[:, None, None] * s**2)
    turn = rate[:, None, None] * np.pi * s + phase[:, None, None]
    wave = np.cos(turn) * tangent[:, None] + np.sin(turn) * side[:, None]
    points = points + depth[:, None, None] * np.minimum(1.0, 3.0 * s) * wave
    # Strands stay outside the scalp.
    distance = np.linalg.norm(points, axis=2, keepdims=True)
    points = points * np.maximum(1.0, (1.0 + 0.02 * np.minimum(1.0, 8.0 * s)) / distance)
    taper = 1.0 - 0.5 * np.linspace(0.0, 1.0, k) ** 2
    return points, radius * taper[None, :] * (0.8 + 0.4 * rng.random(n))[:, None]


def _fur(
    n: int, k: int, rng: np.random.Generator, radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (n, k, 3) and radii (n, k): short combed fibres with strong taper all over."""
    root = _roots(n, rng, -1.0)
    tangent, side = _frames(root)
    flat = COMBED - root * (root @ COMBED)[:, None]
    length = 0.16 + 0.10 * rng.random(n)
    curl = 0.8 + 0.5 * rng.random(n)
    lean = 0.25 * rng.standard_normal((n, 2))
    along = _unit(root + lean[:, :1] * tangent + lean[:, 1:] * side)
    s = np.linspace(0.0, 1.0, k)[None, :, None]
    way = s * (1.0 - 0.35 * s) * along[:, None]
    way = way + (curl[:, None, None] * s**2) * flat[:, None] * 0.7
    points = root[:, None] + length[:, None, None] * way
    taper = 1.0 - 0.9 * np.linspace(0.0, 1.0, k) ** 1.5
    return points, radius * taper[None, :] * (0.8 + 0.4 * rng.random(n))[:, None]


def _roots(n: int, rng: np.random.Generator, lowest: float) -> NDArray[np.float64]:
    """(n, 3) jittered directions on a spiral, z from 1 down to `lowest`."""
    i = np.arange(n) + rng.random(n)
    z = 1.0 - (1.0 - lowest) * i / n
    r = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    return np.stack([r * np.cos(i * GOLDEN_ANGLE), r * np.sin(i * GOLDEN_ANGLE), z], axis=1)


def _frames(direction: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two tangents (n, 3) for every unit direction."""
    upright = np.abs(direction[:, 2:3]) < 0.9
    tangent = _unit(np.cross(np.where(upright, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]), direction))
    return tangent, np.cross(direction, tangent)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
