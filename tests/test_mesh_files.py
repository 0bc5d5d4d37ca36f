"""Mesh files and textures: what is read, what is cleaned, what is refused."""

from __future__ import annotations

import re

import make_head
import numpy as np
import pytest
from mesh_files import obj_text, ply_text
from mesh_shapes import box, sphere
from PIL import Image as Pillow

from furcl.errors import FurclError, ImageError, MeshError, SceneError
from furcl.image import size
from furcl.image.colour import srgb_decode
from furcl.image.image import Image
from furcl.paths import scene_folder
from furcl.scene.mesh import MeshTable
from furcl.scene.read import decode_scene
from furcl.scene.transform import Transform
from furcl.surface.mesh import triangles
from furcl.surface.mesh.mesh import Mesh, Meshes
from furcl.surface.mesh.read import read_mesh
from furcl.surface.mesh.texture import read_texture
from furcl.surface.mesh.triangles import Triangles

CUBE = box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def given(array):
    """An array that is there."""
    assert array is not None
    return array


def written(tmp_path, name, text):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_obj_with_normals_and_texture_coordinates(tmp_path, rng):
    normals, places = rng.standard_normal(CUBE.shape), rng.random((len(CUBE), 3, 2))
    found = read_mesh(written(tmp_path, "a.obj", obj_text(CUBE, normals, places)))
    assert np.allclose(found.vertices[found.faces], CUBE)
    assert np.allclose(given(found.normals)[given(found.normal_faces)], normals)
    assert np.allclose(given(found.places)[given(found.place_faces)], places)


def test_objects_and_polygons_of_an_obj_become_triangles(tmp_path):
    """A square and a triangle; indices from the end; two texture coordinates at one vertex."""
    text = (
        "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE) + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        "o a\nusemtl x\nf 1/1 2/2 3/3 4/4\no b\nusemtl y\nf -4/4 -2/2 -3/3\n"
        "o c\nf 1/1 2/2 3/3\nf 1/1 2/2 3/3 4/4\n"
    )
    found = read_mesh(written(tmp_path, "a.obj", text))
    triangles = Triangles.from_arrays(
        found.vertices, found.faces, places=given(found.places), place_faces=found.place_faces
    )
    assert len(triangles) == 6
    areas = np.linalg.norm(
        np.cross(
            triangles.corners[:, 1] - triangles.corners[:, 0],
            triangles.corners[:, 2] - triangles.corners[:, 0],
        ),
        axis=1,
    )
    assert np.allclose(areas, 1.0)
    at = {
        (*corner.tolist(), *place.tolist())
        for corner, place in zip(
            triangles.corners.reshape(-1, 3), given(triangles.places).reshape(-1, 2), strict=True
        )
    }
    square = {(x, y, 0.0, x, y) for x, y, _ in SQUARE.tolist()}
    assert at == square | {(0.0, 0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 1.0, 0.0)} | {
        (1.0, 0.0, 0.0, 1.0, 1.0)
    }


@pytest.mark.parametrize("binary", [False, True])
def test_ply(tmp_path, binary, rng):
    columns = rng.random((4, 5))
    rows = np.column_stack([SQUARE, columns]).astype(np.float32)
    faces = [[0, 1, 2], [0, 2, 3]]
    text = ply_text(rows, faces, "nx ny nz s t")
    if binary:
        head = text[: text.index("end_header")].replace("ascii", "binary_little_endian")
        body = b"".join(b"\x03" + np.array(face, "<i4").tobytes() for face in faces)
        text = head.encode() + b"end_header\n" + rows.astype("<f4").tobytes() + body
    found = read_mesh(written(tmp_path, "a.ply", text))
    assert np.allclose(found.vertices[found.faces], SQUARE[faces])
    assert np.allclose(given(found.normals)[found.faces], columns[faces][..., :3])
    assert np.allclose(given(found.places)[found.faces], columns[faces][..., 3:])


REFUSED = {
    "empty.obj": ("", "it is empty"),
    "blank.obj": ("\n", "no triangles"),
    "points.obj": ("v 0 0 0\nv 1 0 0\n", "no triangles"),
    "beyond.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "is no .obj file"),
    "nan.obj": ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 0 is at"),
    "large.obj": ("v 0 0 1e12\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "up to 1e+09"),
    "line.obj": ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\nf 1 1 2\n", "on a line"),
    "noise.obj": (b"\x00\xff\x13\x37", "no triangles"),
    "empty.ply": ("", "it is empty"),
    "blank.ply": ("\n", "begins with"),
    "cloud.ply": (ply_text(SQUARE, []), "no triangles"),
    "short.ply": (ply_text(SQUARE, [[0, 1, 2]])[:-20], "it ends before"),
    "beyond.ply": (ply_text(SQUARE, [[0, 1, 7]]), "triangle 0 has the vertices"),
    "flat.obj": ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "line 1: 'v 0 0': expected 3"),
    "mesh.fbx": ("x", "read from .obj, .ply and USD files"),
    "no_uv.obj": (obj_text(CUBE), "has no texture coordinates"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_mesh_is_refused(tmp_path, name):
    """With the file, what was found, and what to do."""
    text, said = REFUSED[name]
    path = written(tmp_path, name, text)
    texture = str(path) if name == "no_uv.obj" else None
    with pytest.raises(MeshError, match=re.escape(said)) as error:
        MeshTable(file=str(path), texture_file=texture).build("mesh.head")
    assert name in str(error.value)
    assert ";" in str(error.value)


def test_triangles_without_an_area_are_left_out():
    corners = np.concatenate([CUBE, CUBE[:2]])
    corners[-2:, 2] = corners[-2:, 1]
    triangles = Triangles.from_arrays(corners.reshape(-1, 3), np.arange(42).reshape(-1, 3))
    assert np.array_equal(triangles.corners, CUBE)
    assert triangles.dropped == {"triangles without an area": 2}


def test_vertices_that_no_triangle_uses_may_be_anything():
    points = np.concatenate([CUBE.reshape(-1, 3), [[np.nan, np.inf, 0.0]]])
    assert len(Triangles.from_arrays(points, np.arange(36).reshape(-1, 3))) == 12


@pytest.mark.parametrize("inside_out", [False, True])
def test_fronts_of_closed_meshes_are_outside(inside_out):
    good = sphere(8)
    points = good.corners.reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)
    made = Triangles.from_arrays(points, faces[:, ::-1] if inside_out else faces, normals=points)
    assert made.is_closed
    assert bool(made.dropped) == inside_out
    face = np.cross(
        made.corners[:, 1] - made.corners[:, 0], made.corners[:, 2] - made.corners[:, 0]
    )
    assert ((face * made.corners.mean(axis=1)).sum(axis=1) > 0.0).all()


def test_made_normals_are_those_of_a_sphere():
    """Also where each triangle has vertices of its own. Measured: 0.3 degrees at the most."""
    triangles = sphere(48)
    cosine = (given(triangles.normals) * triangles.corners).sum(axis=2)
    assert cosine.min() > np.cos(np.radians(0.5))
    assert np.allclose(np.linalg.norm(given(triangles.normals), axis=2), 1.0, atol=1e-6)


def test_normals_without_a_length_are_made(tmp_path):
    normals = np.zeros_like(CUBE)
    normals[0] = [0.0, 0.0, -5.0]
    path = written(tmp_path, "a.obj", obj_text(CUBE, normals))
    found = given(MeshTable(file=str(path)).build().triangles.normals)
    assert np.allclose(np.linalg.norm(found, axis=2), 1.0, atol=1e-6)
    assert np.allclose(found[0], [0.0, 0.0, -1.0])


@pytest.mark.parametrize("scale", [2.0, -2.0], ids=["as it is", "mirrored"])
def test_a_transform_moves_corners_and_normals(tmp_path, scale):
    ball = sphere(8)
    path = written(tmp_path, "a.obj", obj_text(ball.corners, ball.normals))
    place = Transform(scale=(scale, 2.0, 2.0), translate=(1.0, 2.0, 3.0))
    made = MeshTable(file=str(path), transform=place).build().triangles
    centre = np.array([1.0, 2.0, 3.0])
    assert made.bounds()[1] == pytest.approx(centre + 2.0, abs=0.05)
    assert not made.dropped
    assert (((made.corners - centre) / 2.0 * given(made.normals)).sum(axis=2) > 0.98).all()


def test_png_and_exr_textures(tmp_path, rng):
    values = rng.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    Pillow.fromarray(values).save(tmp_path / "a.png")
    linear = srgb_decode(values / 255.0).astype(np.float32)
    assert np.allclose(read_texture(tmp_path / "a.png"), linear, atol=1e-6)
    Image(linear).save(tmp_path / "a.exr")
    assert np.allclose(read_texture(tmp_path / "a.exr"), linear, atol=1e-6)
    Pillow.fromarray(values[..., 0]).save(tmp_path / "grey.png")
    assert np.allclose(read_texture(tmp_path / "grey.png")[..., 2], linear[..., 0], atol=1e-6)
    deep = values[..., 0].astype(np.uint16) * 257
    Pillow.fromarray(deep).save(tmp_path / "deep.png")
    assert np.allclose(read_texture(tmp_path / "deep.png")[..., 1], linear[..., 0], atol=1e-6)


@pytest.mark.parametrize("value", [1.5, -0.1, np.nan])
def test_textures_that_reflect_more_than_all_are_refused(tmp_path, value):
    pixels = np.full((3, 4, 3), 0.5, np.float32)
    pixels[1, 2, 0] = value
    Image(pixels).save(tmp_path / "a.exr")
    with pytest.raises(ImageError, match="row 1, column 2"):
        read_texture(tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("name", "said"), [("a.png", "no picture"), ("a.tga", "are read from"), ("b.png", "b.png")]
)
def test_what_is_no_texture_is_refused(tmp_path, name, said):
    if name != "b.png":
        (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(ImageError, match=said):
        read_texture(tmp_path / name)


SCENES = {
    "missing": ({"file": "nowhere.obj"}, "mesh.head.file"),
    "no file": ({"albedo": 0.5}, "mesh.head.file is missing"),
    "too white": ({"file": "cube.obj", "albedo": 1.5}, "allowed is 0 to 1"),
    "unknown": ({"file": "cube.obj", "colour": 1}, "unknown key mesh.head.colour"),
    "texture": ({"file": "cube.obj", "texture_file": "no.png"}, "mesh.head.texture_file"),
    "flat": ({"file": "cube.obj", "transform": {"scale": 0.0}}, "flattens"),
}


@pytest.mark.parametrize("name", SCENES)
def test_tables_that_cannot_be_are_refused(tmp_path, name):
    table, said = SCENES[name]
    written(tmp_path, "cube.obj", obj_text(CUBE))
    table = {k: str(tmp_path / v) if k.endswith("file") else v for k, v in table.items()}
    document = {
        "fibre": {"preset": "brown"},
        "environment": {"kind": "constant"},
        "curves": {"generator": "fibre"},
        "mesh": {"head": table},
    }
    with pytest.raises(SceneError, match=said):
        decode_scene(document)


@pytest.mark.parametrize("kind", ["GIF", "EPS", "TIFF", "PPM"])
def test_textures_are_told_by_their_first_bytes(tmp_path, rng, kind):
    """Pillow would run other programs, such as Ghostscript, on a PNG that is none."""
    picture = Pillow.fromarray(rng.integers(0, 256, (4, 6, 3), np.uint8))
    picture.save(tmp_path / "a.png", kind)
    with pytest.raises(ImageError, match="is no picture that Pillow reads"):
        read_texture(tmp_path / "a.png")
    picture.save(tmp_path / "b.jpg", "PNG")
    assert read_texture(tmp_path / "b.jpg").shape == (4, 6, 3)


def test_a_texture_of_several_strips_is_that_of_one(tmp_path, rng, monkeypatch):
    pixels = rng.integers(0, 256, (37, 20, 3), np.uint8)
    Pillow.fromarray(pixels).save(tmp_path / "a.png")
    whole = read_texture(tmp_path / "a.png")
    monkeypatch.setattr(size, "STRIP_PIXELS", 100)
    assert np.array_equal(read_texture(tmp_path / "a.png"), whole)
    assert np.array_equal(whole, srgb_decode(pixels / 255.0).astype(np.float32))


@pytest.mark.parametrize("with_normals", [False, True])
def test_a_mesh_of_several_blocks_is_that_of_one(monkeypatch, with_normals):
    points = sphere(8).corners.reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)[:, ::-1]
    normals = np.where(np.arange(len(points))[:, None] % 3, 0.0, points) if with_normals else None
    whole = Triangles.from_arrays(points, faces, normals=normals)
    monkeypatch.setattr(triangles, "BLOCK", 7)
    found = Triangles.from_arrays(points, faces, normals=normals)
    assert found.dropped == whole.dropped
    assert np.array_equal(found.corners, whole.corners)
    assert np.allclose(given(found.normals), given(whole.normals), rtol=0.0, atol=1e-6)


def test_a_texture_needs_places():
    picture = np.ones((2, 2, 3), np.float32)
    with pytest.raises(FurclError, match="texture coordinates"):
        Meshes([Mesh(sphere(8), texture=picture)])


def test_the_head_of_the_portrait_is_what_its_program_makes():
    """Closed and clean. Coordinates are rounded to 1e-4: another processor may round one the other
    way."""
    points, faces = make_head.mesh()
    found = read_mesh(scene_folder() / "head.ply")
    assert np.array_equal(found.faces, faces)
    assert np.abs(found.vertices - points).max() < 1.5e-4
    triangles = Triangles.from_arrays(found.vertices, found.faces)
    assert triangles.is_closed
    assert not triangles.dropped
