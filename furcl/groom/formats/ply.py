"""Strands in Stanford PLY files, ascii or binary, by plyfile."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from furcl.errors import GroomError
from furcl.groom.curves import ADVICE, Curves
from furcl.groom.formats.format import Asked, Format, Strands
from furcl.memory import require_memory
from furcl.ply import read_header
from furcl.values import shown

log = logging.getLogger(__name__)

STRAND_IDS = ("strand_id", "strand", "strand_index", "hair_id", "curve_id")
RADII = {"radius": 1.0, "radii": 1.0, "width": 0.5, "thickness": 0.5}
COLOURS = (("red", "green", "blue"), ("r", "g", "b"))
#: Properties that are no values of strands: normals, alpha.
OTHERS = ("nx", "ny", "nz", "alpha")
#: Points a strand of NeuralHaircut's and other reconstructions' point clouds.
USUAL_POINTS = 100


def read_ply(path: Path, asked: Asked) -> Strands:
    """Read the points of a PLY as strands.

    Strands are told apart by a strand id of every point, by edges between points that follow each
    other, by an element `strand` with a `count`, or by `points_per_strand`; of none of these, a
    multiple of USUAL_POINTS is taken as strands of so many. Single points are counted and left out.

    Raises
    ------
    GroomError      the element and property, or the strand, and a remedy
    """
    elements = _elements(path)
    if "vertex" not in elements:
        raise GroomError(
            f"{path}: has no element 'vertex' but {', '.join(elements) or 'none'}; strands are "
            "vertices with x, y and z. Export them so."
        )
    vertices = elements["vertex"]
    names = vertices.dtype.names or ()
    for name in names:
        if vertices.dtype[name].kind not in "fiu":
            raise GroomError(
                f"{path}: property {name!r} of the vertices is a list; points have numbers alone. "
                "Export it without."
            )
    for name in "xyz":
        if name not in names:
            raise GroomError(
                f"{path}: the vertices have no property {name!r} but {', '.join(names)}; points "
                "need x, y and z. Export them so."
            )
    counts, of_strands, used = _counts(elements, names, asked, path)
    if counts.sum() != len(vertices):
        raise GroomError(
            f"{path}: the strands have {counts.sum()} points, the file {len(vertices)}; repair the "
            "export."
        )
    points = np.column_stack([vertices[c] for c in "xyz"]).astype(np.float32, copy=False)
    radii, radius_name = _radii(vertices, names, asked, path)
    attributes, ignored = _values(vertices, set(names) - {*"xyz", radius_name, *used}, path)
    attributes |= _values(of_strands, set(of_strands.dtype.names or ()) - {"count"}, path)[0]
    kept = counts > 1
    if not kept.all() and kept.any():
        of_points = np.repeat(kept, counts)
        points = points[of_points]
        radii = radii[of_points] if isinstance(radii, np.ndarray) else radii
        attributes = {
            name: values[of_points if len(values) == len(of_points) else kept]
            for name, values in attributes.items()
        }
    dropped = {"single_points": int(np.count_nonzero(~kept))} if kept.any() else {}
    offsets = np.concatenate([[0], np.cumsum(counts[kept] if kept.any() else counts)])
    return Strands(
        points, radii, offsets, str(path), attributes, dropped, ignored
    )  # fmt: skip


def write_ply(curves: Curves, file: BinaryIO, path: Path) -> None:
    """Write vertices x, y, z, radius, strand_id and values of points; values of strands are in an
    element `strand`. Binary, little endian."""
    from plyfile import PlyData, PlyElement

    counts = np.diff(curves.offsets)
    of_points: dict[str, Any] = {axis: curves.points[:, i] for i, axis in enumerate("xyz")}
    of_points |= {
        "radius": curves.radii,
        "strand_id": np.repeat(np.arange(curves.n_strands, dtype=np.int32), counts),
    }
    of_strands: dict[str, Any] = {"count": counts.astype(np.int32)}
    left_out = []
    for name, values in curves.attributes.items():
        columns = of_points if len(values) == curves.n_points else of_strands
        named = _columns(name, values)
        taken = {*columns, *RADII, *STRAND_IDS, *OTHERS, *(c for three in COLOURS for c in three)}
        fits = all(part.isascii() and part.isprintable() and " " not in part for part in named)
        if not fits or (name != "colours" and taken & named.keys()):
            left_out.append(name)
        else:
            columns |= named
    elements = [PlyElement.describe(_table(of_points), "vertex")]
    if len(of_strands) > 1:
        elements.append(PlyElement.describe(_table(of_strands), "strand"))
    PlyData(elements, byte_order="<", comments=["strands by furcl"]).write(file)
    if left_out:
        log.warning("%s: PLY has no place for %s; write .npz to keep it", path, ", ".join(left_out))


def _table(columns):
    table = np.empty(len(next(iter(columns.values()))), [(n, v.dtype) for n, v in columns.items()])
    for name, values in columns.items():
        table[name] = values
    return table


def _columns(name, values):
    """The properties of an array of values."""
    if values.ndim == 1:
        return {name: values}
    names = COLOURS[0] if name == "colours" else [f"{name}_{axis}" for axis in "xyz"]
    return {each: values[:, i] for i, each in enumerate(names)}


def _elements(path: Path) -> dict[str, np.ndarray]:
    """The tables of a PLY file by name."""
    read_header(path, GroomError)
    require_memory(path, n_bytes=4 * path.stat().st_size, error=GroomError)
    from plyfile import PlyData

    try:
        return {element.name: element.data for element in PlyData.read(str(path)).elements}
    except (OSError, MemoryError):
        raise
    except Exception as error:  # plyfile raises whatever its parts raise on damaged files
        raise GroomError(
            f"{path}: plyfile cannot read it: {shown(str(error))}. It is damaged or cut off; fetch "
            "or export it again."
        ) from error


def _counts(elements, names, asked, path):
    """Points of each strand, the table of strands, and the properties that told."""
    vertices, strands = elements["vertex"], elements.get("strand", elements.get("strands"))
    n_points = len(vertices)
    none = np.zeros(0, [("count", "i4")])
    if strands is not None:
        if "count" not in (strands.dtype.names or ()) or strands["count"].dtype.kind not in "iu":
            raise GroomError(
                f"{path}: the element 'strand' has no whole number 'count' of points each; export "
                "it so, or leave the element out."
            )
        counts = strands["count"].astype(np.int64)
        if counts.size and not 0 <= counts.min() <= counts.max() <= n_points:
            raise GroomError(
                f"{path}: counts of strands run from {counts.min()} to {counts.max()}, of "
                f"{n_points} points; repair the export."
            )
        return counts, strands, STRAND_IDS
    for name in STRAND_IDS:
        if name in names:
            return _runs(vertices[name], name, path), none, (name,)
    if "edge" in elements:
        return _chains(elements["edge"], n_points, path), none, ()
    each = asked.points_per_strand
    if "face" in elements and len(elements["face"]) and each is None:
        raise GroomError(
            f"{path}: is a mesh of {len(elements['face'])} faces: nothing says where strands "
            "begin. Name it as [mesh.NAME] of a scene, or export the strands."
        )
    if each is None and n_points % USUAL_POINTS == 0:
        each = USUAL_POINTS
        log.warning(
            "%s: does not say where strands begin; taken as strands of %d points, as NeuralHaircut "
            "writes them (points_per_strand, --points-per-strand, says another number)",
            path,
            each,
        )
    if each is None or n_points % each:
        of = f"strands of {each}" if each else "a multiple of 100"
        raise GroomError(
            f"{path}: {n_points} points are not {of}, and nothing else says where strands begin. "
            f"Give points_per_strand (--points-per-strand), or export a property strand_id."
        )
    return np.full(n_points // each, each, np.int64), none, ()


def _runs(ids, name, path):
    """How many points in a row have the same id."""
    if not len(ids):
        return np.zeros(0, np.int64)
    first = np.flatnonzero(np.concatenate([[True], ids[1:] != ids[:-1]]))
    found = ids[first]
    if len(np.unique(found)) != len(found):
        again = int(np.flatnonzero(np.isin(found, found[:-1]))[-1])
        raise GroomError(
            f"{path}: vertex {first[again]}: {name} {found[again]} comes again after another; the "
            "points of a strand must follow each other, from root to tip. Sort them."
        )
    return np.diff(np.append(first, len(ids)))


def _chains(edges, n_points, path):
    """Points of strands whose neighbours are joined by edges."""
    names = [name for name in ("vertex1", "vertex2") if name in (edges.dtype.names or ())]
    if len(names) != 2 or any(edges[name].dtype.kind not in "iu" for name in names):
        raise GroomError(f"{path}: its edges have no vertex1 and vertex2; export them so.")
    a, b = (edges[name].astype(np.int64) for name in names)
    low = np.minimum(a, b)
    bad = (np.abs(a - b) != 1) | (low < 0) | (low + 1 >= n_points)
    if bad.any():
        at = int(np.argmax(bad))
        raise GroomError(
            f"{path}: edge {at} joins the vertices {a[at]} and {b[at]} of {n_points}; those of a "
            "strand must follow each other, from root to tip. Sort them, or give strand_id."
        )
    joined = np.zeros(n_points, bool)
    joined[low + 1] = True
    return np.diff(np.append(np.flatnonzero(~joined), n_points))


def _radii(vertices, names, asked, path):
    for name, factor in RADII.items():
        if name in names:
            with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                radii = vertices[name].astype(np.float32) * np.float32(factor)
            if radii.any() or asked.default_radius is None:
                return radii, name
            return np.float32(asked.default_radius), name
    if asked.default_radius is None:
        raise GroomError(
            f"{path}: the vertices have no {', '.join(RADII)}, but {', '.join(names)}. {ADVICE}"
        )
    return np.float32(asked.default_radius), ""


def _values(table, names, path):
    """Arrays of the other properties, and the names of those that are none."""
    names, found, ignored = set(names), {}, [name for name in OTHERS if name in names]
    names -= set(ignored)
    for three in COLOURS:
        if names >= set(three):
            found["colours"] = _colours(table, three)
            names -= set(three)
    for name in sorted(names):
        base = name.removesuffix("_x")
        three = [f"{base}_{axis}" for axis in "xyz"]
        if name != base and names >= set(three):
            found[base] = np.column_stack([table[each] for each in three])
            names -= set(three)
    for name in table.dtype.names or ():
        if name in names and table.dtype[name].kind in "fiu":
            found[name] = np.ascontiguousarray(table[name])
    return found, ignored


def _colours(table, three):
    """Linear RGB: whole numbers are sRGB of 0 .. 255 or 65535, as viewers show them."""
    values = np.column_stack([table[name] for name in three])
    if values.dtype.kind == "f":
        return values
    v = values.astype(np.float64) / np.iinfo(values.dtype).max
    return np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0.0) + 0.055) / 1.055) ** 2.4)


FORMAT = Format(
    name="PLY strands",
    suffixes=(".ply",),
    read=read_ply,
    write=write_ply,
    about="Stanford PLY, ascii or binary, by plyfile: what reconstructions of hair write.",
    points="vertices `x y z`, strand after strand, root to tip. Strands are told apart by a "
    f"property `{STRAND_IDS[0]}` ({', '.join(STRAND_IDS[1:])}), by edges, by an element `strand` "
    "with `count`, or by `points_per_strand` (`--points-per-strand`). Without any of these, a "
    f"multiple of {USUAL_POINTS} points is strands of {USUAL_POINTS}, as NeuralHaircut writes "
    "them.",
    radius="`radius`, or half of `width` or `thickness`",
    kept="`red green blue` as colours (whole numbers as sRGB, decimals as linear); every other "
    "number, `NAME_x NAME_y NAME_z` as three; of strands in the element `strand`",
    left_out="normals and alpha; single points are counted. Meshes, strands whose points are not "
    "in a row, and counts that the file cannot hold are refused.",
)
