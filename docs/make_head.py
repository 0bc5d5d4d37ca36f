"""Write scenes/head.ply: a head and neck for the hair of scenes/portrait.toml.

The head is where a sum of smooth solids ends along rays from its middle; its skull is the scalp of
the generator "hair", (0.85, 1, 0.95), a little smaller. z is up, the face looks along -y.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

OUT = Path(__file__).parents[1] / "scenes" / "head.ply"
RINGS, SECTORS = 64, 88
MIDDLE = np.array([0.0, -0.1, -0.35])
LARGEST = 3.0

Array = NDArray[np.float64]


def ellipsoid(p: Array, centre, radii) -> Array:
    """About the distance from an ellipsoid, negative inside."""
    q = (p - np.array(centre)) / np.array(radii)
    length = np.linalg.norm(q, axis=-1)
    return (length - 1.0) * length / np.maximum(np.linalg.norm(q / np.array(radii), axis=-1), 1e-9)


def capsule(p: Array, a, b, radius_a: float, radius_b: float) -> Array:
    """The distance from a cone with round ends."""
    a, b = np.array(a, float), np.array(b, float)
    along = np.clip(((p - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
    gap = np.linalg.norm(p - a - along[..., None] * (b - a), axis=-1)
    return gap - (radius_a + along * (radius_b - radius_a))


def joined(a: Array, b: Array, k: float) -> Array:
    """Both solids, the edge between them filled up over about k."""
    h = np.clip(0.5 + 0.5 * (b - a) / k, 0.0, 1.0)
    return b + h * (a - b) - k * h * (1.0 - h)


def carved(a: Array, b: Array, k: float) -> Array:
    """The first without the second."""
    return -joined(-a, b, k)


def head(p: Array) -> Array:
    """Negative inside the head; it is the same on both sides."""
    p = np.stack([np.abs(p[..., 0]), p[..., 1], p[..., 2]], axis=-1)
    d = ellipsoid(p, (0.0, 0.0, 0.0), (0.84, 0.99, 0.94))
    d = joined(d, ellipsoid(p, (0.0, -0.42, -0.55), (0.60, 0.50, 0.62)), 0.30)  # face
    d = joined(d, ellipsoid(p, (0.0, -0.62, -1.02), (0.30, 0.26, 0.20)), 0.28)  # chin
    d = joined(d, ellipsoid(p, (0.42, -0.55, -0.48), (0.18, 0.20, 0.16)), 0.25)  # cheek
    d = joined(d, capsule(p, (0.0, -0.93, -0.20), (0.0, -1.10, -0.58), 0.06, 0.10), 0.14)  # nose
    d = joined(d, ellipsoid(p, (0.09, -1.02, -0.60), (0.075, 0.09, 0.06)), 0.06)
    d = carved(d, ellipsoid(p, (0.31, -1.02, -0.25), (0.19, 0.17, 0.13)), 0.14)  # eye
    d = joined(d, ellipsoid(p, (0.31, -0.80, -0.25), (0.13, 0.13, 0.13)), 0.03)
    d = joined(d, capsule(p, (0.12, -0.94, -0.08), (0.46, -0.80, -0.07), 0.06, 0.05), 0.12)  # brow
    d = joined(d, capsule(p, (0.0, -0.93, -0.80), (0.16, -0.88, -0.81), 0.040, 0.015), 0.04)  # lips
    d = joined(d, capsule(p, (0.0, -0.925, -0.88), (0.13, -0.88, -0.87), 0.048, 0.02), 0.04)
    d = joined(d, ellipsoid(p, (0.83, 0.05, -0.40), (0.07, 0.15, 0.22)), 0.06)  # ear
    neck = capsule(p, (0.0, 0.12, -0.8), (0.0, 0.25, -2.0), 0.44, 0.50)
    return joined(d, neck, 0.22)


def surface(directions: Array) -> Array:
    """Points where rays from the middle leave the head for the last time."""
    steps = np.linspace(0.0, LARGEST, 241)
    inside = head(MIDDLE + steps[:, None, None] * directions) < 0.0
    last = len(steps) - 1 - inside[::-1].argmax(axis=0)
    low, high = steps[last], steps[np.minimum(last + 1, len(steps) - 1)]
    for _ in range(24):
        middle = 0.5 * (low + high)
        within = head(MIDDLE + middle[:, None] * directions) < 0.0
        low, high = np.where(within, middle, low), np.where(within, high, middle)
    return MIDDLE + low[:, None] * directions


def mesh() -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Vertices (m, 3) and triangles (n, 3), against the clock from outside.

    Rings are around the y axis, so that the face, where most is to be seen, has the finest of them;
    each pole is a ring of one point many times.
    """
    theta = np.linspace(0.0, np.pi, RINGS + 1) ** 1.25 * np.pi**-0.25
    phi = np.arange(SECTORS) * 2.0 * np.pi / SECTORS
    around = np.stack([np.cos(phi), np.zeros(SECTORS), np.sin(phi)], axis=1)
    directions = np.sin(theta)[:, None, None] * around
    directions[:, :, 1] = -np.cos(theta)[:, None]
    points = surface(directions.reshape(-1, 3)).round(4).astype(np.float32)
    i, j = np.meshgrid(np.arange(RINGS), np.arange(SECTORS), indexing="ij")
    a, b = i * SECTORS + j, i * SECTORS + (j + 1) % SECTORS
    quads = np.stack([a, a + SECTORS, b + SECTORS, b], axis=2).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    corners = points[faces]
    same = (corners == np.roll(corners, 1, axis=1)).all(axis=2).any(axis=1)
    return points, faces[~same].astype(np.int32)


def write(path: Path = OUT) -> None:
    """Write the mesh as binary PLY."""
    points, triangles = mesh()
    head_lines = [
        "ply", "format binary_little_endian 1.0", "comment docs/make_head.py",
        f"element vertex {len(points)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    faces = np.empty(len(triangles), np.dtype([("n", "u1"), ("v", "<i4", 3)]))
    faces["n"], faces["v"] = 3, triangles
    text = "\n".join(head_lines) + "\n"
    path.write_bytes(text.encode() + points.astype("<f4").tobytes() + faces.tobytes())


if __name__ == "__main__":
    write()
