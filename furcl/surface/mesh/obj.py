"""Wavefront OBJ files, read block by block.

Libraries hold a text in pieces of Python, ten times its length and more. What is read here are
vertices, their normals and texture coordinates, and polygons.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.surface.mesh.text import Rows, blocks, fans, numbers
from furcl.values import shown

#: Statement -> how many of its numbers are used (weights and colours come after them), as what,
#: the name of the values and that of their indices.
KINDS: dict[str, tuple[int, Any, str, str]] = {
    "v": (3, np.float64, "vertices", "faces"),
    "vt": (2, np.float32, "places", "place_faces"),
    "vn": (3, np.float32, "normals", "normal_faces"),
}
LONGEST_CORNER = 80  # characters of 1/2/3
#: Of corners that have no texture coordinate or no normal; of indices before the first.
NONE, BEFORE = -1, -2


def read_obj(path: Path, check_size: Callable[[int], None]) -> dict[str, Any]:
    """The polygons of all objects and groups, as triangles, in the order of the file.

    Texture coordinates and normals are used where all corners have them.

    Parameters
    ----------
    check_size : function       of the triangles so far, called after each block

    Returns
    -------
    dict            of fields of furcl.surface.mesh.read.MeshArrays

    Raises
    ------
    ValueError      the line, and what is wrong with it
    """
    tables = {key: Rows() for key in KINDS}
    triangles = Rows()
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for first, lines in blocks(file, carries_on="\\"):
            texts, seen = _sorted(lines, [table.n for table in tables.values()])
            for key, (width, dtype, *_) in KINDS.items():
                if texts[key]:
                    rows = _or_blame(partial(_rows, width), key, texts[key], first, lines)
                    tables[key].append(rows.reshape(-1, width).astype(dtype, copy=False))
            if texts["f"]:
                corners, counts = _or_blame(_corners, "f", texts["f"], first, lines)
                triangles.append(_triangles(corners, counts, seen))
                check_size(triangles.n)
    if not triangles.n:
        return {}
    index = triangles.array()
    found: dict[str, Any] = {}
    for k, (key, (_, _, name, index_name)) in enumerate(KINDS.items()):
        _check_range(index[:, :, k], tables[key].n, key)
        if index[:, :, k].min() > NONE:
            found |= {name: tables[key].array(), index_name: index[:, :, k]}
    return found


def _check_range(index: NDArray[np.int32], n: int, key: str) -> None:
    bad = ((index < NONE) | (index >= n)).any(axis=1)
    if bad.any():
        at = int(np.flatnonzero(bad)[0])
        raise ValueError(
            f"triangle {at} has the corners {(index[at] + 1).tolist()} of {n} lines of {key}"
        )


def _sorted(
    lines: Sequence[str], before: Sequence[int]
) -> tuple[dict[str, list[str]], NDArray[np.int64]]:
    """What follows each kind of statement, and how much of each other kind comes before faces."""
    texts: dict[str, list[str]] = {key: [] for key in (*KINDS, "f")}
    v, vt, vn, faces = texts.values()
    seen = []
    for line in lines:
        words = line.split(None, 1)
        if len(words) == 2 and (of_kind := texts.get(words[0])) is not None:
            of_kind.append(words[1].partition("#")[0])
            if of_kind is faces:
                seen.append((len(v), len(vt), len(vn)))
    return texts, np.array(seen, np.int64).reshape(-1, 3) + np.array(before)


def _or_blame(
    parse: Callable[[list[str]], Any], key: str, texts: list[str], first: int, lines: list[str]
) -> Any:
    """What statements say; of those that cannot be read, the first."""
    try:
        return parse(texts)
    except ValueError:
        for number, line in enumerate(lines, first):
            words = line.split(None, 1)
            if len(words) == 2 and words[0] == key:
                try:
                    parse([words[1].partition("#")[0]])
                except ValueError as error:
                    raise ValueError(f"line {number}: {shown(line)}: {error}") from None
        raise


def _rows(width: int, texts: list[str]) -> NDArray[np.float64]:
    rows = [text.split(None, width)[:width] for text in texts]
    if any(len(row) != width for row in rows):
        raise ValueError(f"expected {width} numbers")
    return numbers([word for row in rows for word in row])


def _corners(texts: list[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Corners (n, 3) of polygons, of v/vt/vn with 0 for none, and how many each polygon has."""
    counts = np.array([len(text.split()) for text in texts], np.int64)
    if counts.min() < 3:
        raise ValueError("a face has three corners or more")
    text = " ".join(" ".join(texts).split()) + " "
    words = text.replace("//", "/0/").replace("/ ", " ").split()
    if max(map(len, words)) > LONGEST_CORNER:
        raise ValueError(f"a corner of more than {LONGEST_CORNER} characters")
    n_slashes = np.strings.count(np.array([word.encode() for word in words]), b"/")
    if n_slashes.max() > 2:
        raise ValueError("expected corners such as 1, 1/2, 1//3 or 1/2/3")
    corners = np.zeros((len(words), 3), np.int64)
    for n in np.unique(n_slashes).tolist():
        of_form = n_slashes == n
        found = numbers("/".join(compress(words, of_form)).split("/"), np.int64)
        corners[of_form, : n + 1] = found.reshape(-1, n + 1)
    if not corners[:, 0].all():
        raise ValueError("vertices are counted from 1, or from -1 backwards")
    return corners, counts


def _triangles(
    corners: NDArray[np.int64], counts: NDArray[np.int64], seen: NDArray[np.int64]
) -> NDArray[np.int32]:
    """Indices (m, 3 corners, 3 kinds) from 0; what is outside of int32 is outside of all."""
    back = np.repeat(seen, counts, axis=0) + corners
    index = np.where(corners < 0, np.where(back < 0, BEFORE, back), corners - 1)
    return np.minimum(index, np.iinfo(np.int32).max).astype(np.int32)[fans(counts)]
