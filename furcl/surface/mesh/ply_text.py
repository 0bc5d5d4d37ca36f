"""Stanford PLY files in text, read block by block.

Libraries hold each row as an object of Python, several times what is made of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.ply import Element, Header
from furcl.surface.mesh.ply import joined, of_faces, of_vertices, whole_numbers
from furcl.surface.mesh.text import Rows, blocks, numbers
from furcl.values import shown

LINES_OF_HEADER = 10_000


def read_text_ply(path: Path, header: Header, check_size: Callable[[int], None]) -> dict[str, Any]:
    """The polygons of a file, as triangles, in its order.

    Texture coordinates are those of the corners of the polygons, or of the vertices.

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
    tables: dict[str, Rows] = {}
    for element, first, lines in _rows(path, header):
        if element.name in ("vertex", "face"):
            for name, rows in _or_blame(lines, element, first).items():
                tables.setdefault(name, Rows()).append(rows)
            if "faces" in tables:
                check_size(tables["faces"].n)
    return joined({name: table.array() for name, table in tables.items()})


def _rows(path: Path, header: Header) -> Iterator[tuple[Element, int, list[str]]]:
    """Rows of one element at a time, with the number of the line of the first."""
    with path.open(encoding="utf-8", errors="replace") as file:
        every = blocks(file)
        number, lines = next(every, (1, []))
        number, lines = number + header.n_lines, lines[header.n_lines :]
        for element in header.elements:
            left = element.count
            while left:
                if not lines:
                    number, lines = next(every, (0, []))
                if not lines:
                    raise ValueError(f"it ends before {left} rows of the element {element.name}")
                taken, lines = lines[:left], lines[left:]
                yield element, number, taken
                number, left = number + len(taken), left - len(taken)


def _or_blame(lines: list[str], element: Element, first: int) -> dict[str, NDArray[Any]]:
    """What rows say; of those that cannot be read, the first."""
    try:
        return _parsed(lines, element)
    except ValueError:
        for number, line in enumerate(lines, first):
            try:
                _parsed([line], element)
            except ValueError as error:
                raise ValueError(f"line {number}: {shown(line)}: {error}") from None
        raise


def _parsed(lines: list[str], element: Element) -> dict[str, NDArray[Any]]:
    scalars, lists = _columns(lines, element)
    if element.name == "vertex":
        return of_vertices(scalars)
    if not lists:
        raise ValueError("a face without a list of vertices")
    return of_faces(lists)


def _columns(
    lines: list[str], element: Element
) -> tuple[dict[str, NDArray[Any]], dict[str, tuple[NDArray[Any], NDArray[np.int64]]]]:
    """Of the properties with one number a row these, of lists all their numbers and how many each
    row has."""
    rows = [line.split() for line in lines]
    lengths = np.array([len(row) for row in rows])
    flat = numbers([word for row in rows for word in row])
    ends = np.cumsum(lengths)
    at = ends - lengths
    scalars, lists = {}, {}
    for name, is_list in element.properties:
        if (at >= ends).any():
            raise ValueError(f"ends before {name}")
        values = flat[at]
        at = at + 1
        if not is_list:
            scalars[name] = values
            continue
        counts = whole_numbers(values).astype(np.int64)
        if (counts < 0).any() or (at + counts > ends).any():
            raise ValueError(f"ends before the list {name} does")
        step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        lists[name] = flat[np.repeat(at, counts) + step], counts
        at = at + counts
    if (at != ends).any():
        raise ValueError("more numbers than its properties take")
    return scalars, lists
