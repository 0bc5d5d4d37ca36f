"""Mesh files made by hand for the tests, without the library that reads them."""

from __future__ import annotations

import numpy as np


def obj_text(corners, normals=None, places=None):
    """Triangles (n, 3, 3) as OBJ, each with vertices of its own."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners.reshape(-1, 3).tolist()]
    parts = ["{0}"] * 3
    if places is not None:
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in places.reshape(-1, 2).tolist()]
        parts[1] = "{0}"
    else:
        parts[1] = ""
    if normals is not None:
        lines += [f"vn {x:.9g} {y:.9g} {z:.9g}" for x, y, z in normals.reshape(-1, 3).tolist()]
    else:
        parts[2] = ""
    word = "/".join(parts).rstrip("/")
    for first in range(1, 3 * len(corners) + 1, 3):
        lines.append("f " + " ".join(word.format(first + k) for k in range(3)))
    return "\n".join(lines) + "\n"


def ply_text(vertices, faces, columns=""):
    """ASCII PLY; `columns` names what the columns of vertices after x, y, z are."""
    names = ["x", "y", "z", *columns.split()]
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name in names]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(f"{x:.9g}" for x in row) for row in np.asarray(vertices).tolist()]
    rows += [" ".join(map(str, [len(face), *face])) for face in faces]
    return "\n".join([*head, *rows]) + "\n"
