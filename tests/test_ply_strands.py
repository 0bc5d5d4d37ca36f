"""Strands in PLY: each way to tell them apart, ascii and binary, and bad files."""

import struct

import numpy as np
import pytest

from furcl.errors import GroomError
from furcl.groom.formats import load_curves

XYZ = "property float x\nproperty float y\nproperty float z\n"
ROWS = [(0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 0, 1), (1, 0, 2)]


def header(elements, form="ascii"):
    text = f"ply\nformat {form} 1.0\ncomment by hand\n"
    for name, count, properties in elements:
        text += f"element {name} {count}\n{properties}"
    return text + "end_header\n"


def ascii_ply(columns="", values=None, rows=ROWS, more=(), more_rows=""):
    elements = [("vertex", len(rows), XYZ + columns), *more]
    lines = [
        " ".join(map(str, (*row, *(values[i] if values else ())))) for i, row in enumerate(rows)
    ]
    return header(elements) + "\n".join(lines) + "\n" + more_rows


def written(folder, data):
    path = folder / "a.ply"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def by_id(name="strand_id", radius="radius"):
    return ascii_ply(
        f"property int {name}\nproperty float {radius}\n",
        [(7, 0.5), (7, 0.25), (3, 0.1), (3, 0.1), (3, 0.2)],
    )


EDGES = "property int vertex1\nproperty int vertex2\n"
TOLD = {
    "strand id": by_id(),
    "hair id": by_id("hair_id"),
    "edges": ascii_ply(more=[("edge", 3, EDGES)], more_rows="0 1\n3 2\n3 4\n"),
    "counts": ascii_ply(more=[("strand", 2, "property int count\n")], more_rows="2\n3\n"),
}


@pytest.mark.parametrize("told", TOLD)
def test_strands(tmp_path, told):
    curves = load_curves(written(tmp_path, TOLD[told]), default_radius=0.5)
    np.testing.assert_array_equal(curves.points, ROWS)
    np.testing.assert_array_equal(curves.offsets, [0, 2, 5])


@pytest.mark.parametrize(("name", "factor"), [("radius", 1.0), ("width", 0.5), ("thickness", 0.5)])
def test_radii(tmp_path, name, factor):
    curves = load_curves(written(tmp_path, by_id(radius=name)))
    expected = np.array([0.5, 0.25, 0.1, 0.1, 0.2], np.float32) * np.float32(factor)
    np.testing.assert_array_equal(curves.radii, expected)


@pytest.mark.parametrize(
    ("form", "sign"), [("binary_little_endian", "<"), ("binary_big_endian", ">")]
)
def test_binary(tmp_path, form, sign):
    colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    columns = XYZ + "property int strand_id\nproperty double radius\n" + colours
    data = header([("vertex", 5, columns)], form).encode()
    for i, row in enumerate(ROWS):
        data += struct.pack(f"{sign}3fid3B", *row, i // 2 if i < 4 else 1, 0.1, 255, 0, 188)
    curves = load_curves(written(tmp_path, data))
    np.testing.assert_array_equal(curves.points, ROWS)
    np.testing.assert_array_equal(curves.radii, np.float32(0.1))
    assert curves.colours is not None
    # sRGB 188 of 255 is half of the light.
    np.testing.assert_allclose(curves.colours[0], [1.0, 0.0, 0.5029], atol=1e-4)


def test_points_per_strand(tmp_path, caplog):
    rows = [(i // 4, 0, i % 4) for i in range(8)]
    path = written(tmp_path, ascii_ply(rows=rows))
    with pytest.raises(
        GroomError, match=r"8 points are not a multiple of 100.*--points-per-strand"
    ):
        load_curves(path, 0.1)
    np.testing.assert_array_equal(load_curves(path, 0.1, points_per_strand=4).offsets, [0, 4, 8])
    with pytest.raises(GroomError, match="8 points are not strands of 3"):
        load_curves(path, 0.1, points_per_strand=3)
    rows = [(i // 100, 0, i % 100) for i in range(300)]
    assert load_curves(written(tmp_path, ascii_ply(rows=rows)), 0.1).n_strands == 3
    assert "taken as strands of 100 points" in caplog.text


def test_single_points_are_counted(tmp_path):
    data = ascii_ply("property int strand_id\n", [(0,), (0,), (1,), (2,), (2,)])
    curves = load_curves(written(tmp_path, data), 0.1)
    assert dict(curves.dropped) == {"single_points": 1}
    np.testing.assert_array_equal(curves.points, np.array(ROWS)[[0, 1, 3, 4]])


FACES = ("face", 1, "property list uchar int vertex_indices\n")
BAD = {
    "no ply": ("play", "begins with b'pla'"),
    "cut header": (by_id()[:60], "no end_header"),
    "cut off": (by_id()[:-12], "plyfile cannot read it"),
    "2^31 vertices": (by_id().replace("vertex 5", f"vertex {2**31}"), "claims 2147483648 rows"),
    "no vertices": (by_id().replace("vertex", "point"), "no element 'vertex' but point"),
    "no z": (by_id().replace("float z", "float w"), "no property 'z' but x, y, w"),
    "a list": (
        by_id().replace("float radius", "list uchar int many"),
        "cannot read it|'many' of the vertices is a list",
    ),
    "no radius": (TOLD["edges"], "no radius, radii, width, thickness, but x, y, z.*default-radius"),
    "a mesh": (ascii_ply(more=[FACES], more_rows="3 0 1 2\n"), "is a mesh of 1 faces"),
    "ids again": (
        ascii_ply("property int strand\n", [(0,), (1,), (0,), (1,), (1,)]),
        "vertex 3: strand 1 comes again",
    ),
    "far edges": (
        ascii_ply(more=[("edge", 1, EDGES)], more_rows="0 2\n"),
        "edge 0 joins the vertices 0 and 2",
    ),
    "too few": (
        ascii_ply(more=[("strand", 1, "property int count\n")], more_rows="4\n"),
        "the strands have 4 points, the file 5",
    ),
    "negative": (
        ascii_ply(more=[("strand", 1, "property int count\n")], more_rows="-4\n"),
        "counts of strands run from -4",
    ),
    "nan": (by_id().replace("1 0 2", "1 0 nan"), "strand 1, point 2 is .*nan"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path, case):
    data, message = BAD[case]
    with pytest.raises(GroomError, match=message):
        load_curves(written(tmp_path, data))
