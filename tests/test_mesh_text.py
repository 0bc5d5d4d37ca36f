"""Meshes in text, read block by block: as another library reads them, and as they were made."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from plyfile import PlyData
from trimesh.exchange.obj import load_obj
from trimesh.exchange.ply import load_ply
from trimesh.geometry import triangulate_quads

from furcl.errors import MeshError
from furcl.surface.mesh import text
from furcl.surface.mesh.read import read_mesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def corners_of(found):
    """Position of each corner (n, 3, 3), its normal and its place in a texture, side by side."""
    parts = [found.vertices[found.faces]]
    if found.normals is not None:
        parts.append(
            found.normals[found.faces if found.normal_faces is None else found.normal_faces]
        )
    if found.places is not None:
        parts.append(found.places[found.faces if found.place_faces is None else found.place_faces])
    return np.concatenate(parts, axis=2)


def corners_by_trimesh(objects):
    out = []
    for each in objects:
        faces = triangulate_quads(each["faces"])
        parts = [np.asarray(each["vertices"])[faces]]
        if each.get("vertex_normals") is not None:
            parts.append(np.asarray(each["vertex_normals"])[faces])
        if each.get("visual") is not None:
            parts.append(np.asarray(each["visual"].uv)[faces])
        out.append(np.concatenate(parts, axis=2))
    return np.concatenate(out)


def in_order(corners):
    """Triangles sorted, each from its least corner: libraries have orders of their own."""
    triangles = [list(map(tuple, each)) for each in corners.astype(np.float32).tolist()]
    starts = [each.index(min(each)) for each in triangles]
    return sorted(each[k:] + each[:k] for each, k in zip(triangles, starts, strict=True))


def assert_same(found, objects):
    assert in_order(corners_of(found)) == in_order(corners_by_trimesh(objects))


def assert_same_obj(path):
    with path.open() as file:
        geometry = load_obj(file, skip_materials=True)["geometry"]
    assert_same(read_mesh(path), geometry.values())


def test_a_real_obj_is_that_of_trimesh(shared_data):
    """15,000 lines by Blender: triangles and quads."""
    assert_same_obj(shared_data / "mesh" / "sintel_head.obj")


@pytest.mark.parametrize("name", ["bunny", "bear_body"])
def test_real_plys_are_those_of_trimesh(shared_data, tmp_path, name):
    """Binary, and as text."""
    path = shared_data / "mesh" / f"{name}.ply"
    with path.open("rb") as file:
        expected = load_ply(file, skip_materials=True)
    assert_same(read_mesh(path), [expected])
    data = PlyData.read(str(path))
    data.text = True
    data.write(str(tmp_path / "a.ply"))
    assert_same(read_mesh(tmp_path / "a.ply"), [expected])


def polygons(rng, n_vertices, n_faces, sides):
    return [
        rng.choice(n_vertices, size=rng.choice(sides), replace=False).tolist()
        for _ in range(n_faces)
    ]


def fans(faces):
    return np.array([[f[0], f[i], f[i + 1]] for f in faces for i in range(1, len(f) - 1)])


@pytest.mark.parametrize("seed", range(24))
def test_objs_are_what_they_were_made_of(tmp_path, monkeypatch, seed):
    """Any polygons, indices from both ends between vertices that are still to come, lines that go
    on, and blocks of a few lines."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(6, 30))
    tables = [rng.standard_normal((n, 3)).round(4) for _ in range(3)]
    has_places, has_normals = rng.random(2) < 0.6
    lines, made, at = ["# made", "mtllib a.mtl", "o a"], [], 0
    while at < n:
        step = max(int(rng.integers(1, n)), 6 if not at else 1)
        for key, table, used in zip(
            ("v", "vt", "vn"), tables, (True, has_places, has_normals), strict=True
        ):
            rows = table[at : at + step, : 2 if key == "vt" else 3]
            lines += [
                f"{key} " + " ".join(f"{x:.4f}" for x in row) for row in rows.tolist() if used
            ]
        at = min(at + step, n)
        for face in polygons(rng, at, int(rng.integers(1, 9)), (3, 3, 4, 5)):
            numbers = [[v, *rng.integers(0, at, 2).tolist()] for v in face]
            words = []
            for each in numbers:
                v, t, m = (k + 1 if rng.random() < 0.7 else k - at for k in each)
                word = f"{v}/{t if has_places else ''}/{m if has_normals else ''}"
                words.append(word.rstrip("/"))
            gap = " \\\n " if rng.random() < 0.2 else "  "
            lines.append(
                f"{'usemtl b' if rng.random() < 0.1 else 's off'}\nf {gap.join(words)} # f"
            )
            made.append(numbers)
    newline = "\r\n" if seed % 2 else "\n"
    path = tmp_path / "a.obj"
    path.write_bytes((newline.join(lines) + newline * (seed % 3)).replace("\n\n", "\n").encode())
    monkeypatch.setattr(text, "BLOCK_CHARACTERS", int(rng.choice([200, 1 << 19])))
    index = fans(made)
    expected = [tables[0][index[..., 0]]]
    expected += [tables[2][index[..., 2]]] if has_normals else []
    expected += [tables[1][index[..., 1], :2]] if has_places else []
    found = corners_of(read_mesh(path))
    assert np.allclose(found, np.concatenate(expected, axis=2), rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("form", ["{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}"])
@pytest.mark.parametrize("sides", [(3,), (4,), (3, 4, 5)])
def test_objs_are_those_of_trimesh(tmp_path, rng, form, sides):
    lines = [
        f"{key} {x:.4f} {y:.4f} {z:.4f}" for key in ("v", "vn") for x, y, z in rng.random((30, 3))
    ]
    lines += [f"vt {x:.4f} {y:.4f}" for x, y in rng.random((30, 2))]
    for face in polygons(rng, 30, 40, sides):
        words = (form.format(v + 1, *rng.integers(1, 31, 2)) for v in face)
        lines.append("f " + " ".join(words))
    (tmp_path / "a.obj").write_text("\n".join(lines))
    assert_same_obj(tmp_path / "a.obj")


@pytest.mark.parametrize("sides", [(3,), (4,), (3, 4, 6)])
@pytest.mark.parametrize("names", ["x y z", "x y z red", "y x z texture_u texture_v"])
@pytest.mark.parametrize("of_corners", [False, True])
def test_plys_of_text_are_those_of_trimesh(tmp_path, monkeypatch, rng, sides, names, of_corners):
    faces = polygons(rng, 20, 30, sides)
    if of_corners and len(sides) > 1:
        pytest.skip("trimesh reads no texture coordinates of polygons that differ")
    head = "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 20\n"
    head += "".join(f"property double {name}\n" for name in names.split())
    head += "element other 2\nproperty list uchar int a\n"
    head += f"element face {len(faces)}\nproperty uchar flags\n"
    head += "property list uchar int vertex_indices\n"
    head += "property list uchar float texcoord\n" * of_corners + "end_header\n"
    rows = [" ".join(f"{x:.4f}" for x in row) for row in rng.random((20, len(names.split())))]
    rows += ["2 1 1", "0"]
    for face in faces:
        row = [7, len(face), *face]
        if of_corners:
            row += [2 * len(face), *rng.random(2 * len(face)).round(3).tolist()]
        rows.append(" ".join(map(str, row)))
    data = (head + "\n".join(rows) + "\n").encode()
    (tmp_path / "a.ply").write_bytes(data)
    expected = load_ply(io.BytesIO(data), skip_materials=True)
    assert_same(read_mesh(tmp_path / "a.ply"), [expected])
    monkeypatch.setattr(text, "BLOCK_CHARACTERS", len(head) + 9)
    assert_same(read_mesh(tmp_path / "a.ply"), [expected])


REFUSED = {
    "word": ("v 0 0 x\n", "line 5: 'v 0 0 x'"),
    "two corners": ("f 1 2\n", "line 5: 'f 1 2': a face has three"),
    "four numbers": ("f 1/1/1/1 2 3\n", "line 5: "),
    "zero": ("f 0 1 2\n", "counted from 1"),
    "far": ("f 1 2 99999999999\n", "of 4 lines of v"),
    "back": ("f -1 -2 -5\n", "of 4 lines of v"),
    "normal": ("f 1//1 2//1 3//1\n", "of 0 lines of vn"),
    "fraction": ("f 1.5 2 3\n", "line 5: "),
    "no number": ("f a b c\n", "line 5: "),
    "long corner": ("f 1 2 " + "3" * 100 + "\n", "line 5: "),
}


@pytest.mark.parametrize("name", REFUSED)
def test_damage_is_told_by_its_line(tmp_path, name):
    more, said = REFUSED[name]
    (tmp_path / "a.obj").write_text(SQUARE + more + "f 1 2 3\n")
    with pytest.raises(MeshError, match=re.escape(said)):
        read_mesh(tmp_path / "a.obj")


def test_a_line_without_an_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "BLOCK_CHARACTERS", 64)
    (tmp_path / "a.obj").write_text(SQUARE + "f " + "1 " * 200)
    with pytest.raises(MeshError, match="a line of more than 64 characters"):
        read_mesh(tmp_path / "a.obj")


def test_polygons_that_fill_the_memory_are_refused(tmp_path, monkeypatch):
    """Two bytes of a file may be a triangle."""
    from furcl.surface.mesh import read

    monkeypatch.setattr(read, "TRIANGLE_PEAK", 1 << 50)
    (tmp_path / "a.obj").write_text(SQUARE + "f 1 2 3 4 1 2 3 4\n")
    with pytest.raises(MeshError, match="MiB to be read"):
        read_mesh(tmp_path / "a.obj")


def test_faces_of_binary_plys_are_all_alike(tmp_path):
    """plyfile reads others one by one, which takes ten times as long as a text does."""
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
    head += "property float y\nproperty float z\nelement face 2\n"
    head += "property list uchar int vertex_index\nend_header\n"
    body = np.zeros((4, 3), "<f4").tobytes()
    for face in ([0, 1, 2, 3], [0, 1, 2]):
        body += bytes([len(face)]) + np.array(face, "<i4").tobytes()
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    with pytest.raises(MeshError, match="cut them into triangles"):
        read_mesh(tmp_path / "a.ply")
