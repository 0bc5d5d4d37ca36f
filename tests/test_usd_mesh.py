"""Meshes in USD: polygons, orientation, normals, texture coordinates, and strands beside them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from test_usd import listed, prim, written
from typer.testing import CliRunner

from furcl.cli import app
from furcl.errors import MeshError
from furcl.groom.formats import usd, usd_stage
from furcl.groom.formats.usd_mesh import read_mesh
from furcl.image.image import Image
from furcl.scene.mesh import MeshTable
from furcl.scene.read import load_scene

pytest.importorskip("pxr", reason="usd-core is an extra")
# A square and a pentagon on it, as a roof, with y up.
POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 1.5, 0)]
COUNTS, INDICES = (4, 3), (0, 1, 2, 3, 3, 2, 4)


@pytest.fixture
def here(monkeypatch):
    """Files that are known to be whole are read by this process, which is faster."""

    def extracted(path, what="curves"):
        said, arrays = usd_stage.extract(str(path), what)
        return said, {name: array.copy() for name, array in arrays.items()}

    monkeypatch.setattr(usd, "extracted", extracted)


def mesh(name="m", points=POINTS, counts=COUNTS, indices=INDICES, more=""):
    """A prim of Mesh as text."""
    return (
        f'def Mesh "{name}"\n{{\n    int[] faceVertexCounts = {list(counts)}\n'
        f"    int[] faceVertexIndices = {list(indices)}\n"
        f"    point3f[] points = {listed(points)}\n{more}}}\n"
    )


def corners(found):
    return found.vertices[found.faces]


def area(found):
    """Sum of the triangles' vectors of area (3,)."""
    a, b, c = np.moveaxis(corners(found), 1, 0)
    return 0.5 * np.cross(b - a, c - a).sum(axis=0)


def test_polygons_become_triangles_and_z_is_up(here, tmp_path):
    """The front of the square faces +z in the file, where y is up: -y when z is."""
    found = read_mesh(written(tmp_path, mesh()))
    assert corners(found).shape == (3, 3, 3)
    expected = np.array(POINTS)[[[0, 1, 2], [0, 2, 3], [3, 2, 4]]]
    np.testing.assert_allclose(corners(found), expected[..., [0, 2, 1]] * [1, -1, 1])
    np.testing.assert_allclose(area(found), [0, -1.25, 0], atol=1e-12)
    z_up = read_mesh(written(tmp_path, mesh(), 'upAxis = "Z"'))
    np.testing.assert_allclose(corners(z_up), expected)
    assert z_up.normals is None
    assert z_up.places is None


@pytest.mark.parametrize("left", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_fronts(here, tmp_path, left, mirrored):
    """Left-handed orders of corners and mirrors turn the front; both leave it as it is."""
    more = '    uniform token orientation = "leftHanded"\n' if left else ""
    if mirrored:
        more += "    double3 xformOp:scale = (1, 1, -2)\n"
        more += '    uniform token[] xformOpOrder = ["xformOp:scale"]\n'
    found = read_mesh(written(tmp_path, mesh(more=more), 'upAxis = "Z"'))
    # A mirror across the plane of the mesh: its front goes to the other side.
    sign = (-1) ** (left + mirrored)
    np.testing.assert_allclose(area(found), [0, 0, 1.25 * sign], atol=1e-12)


def test_transformations_turn_normals(here, tmp_path):
    more = (
        f"    normal3f[] normals = {listed([(0.6, 0, 0.8)] * 5)} "
        '(interpolation = "vertex")\n    double3 xformOp:scale = (2, 1, 1)\n'
        '    uniform token[] xformOpOrder = ["xformOp:scale"]\n'
    )
    found = read_mesh(written(tmp_path, mesh(more=more), 'upAxis = "Z"'))
    expected = np.array([0.3, 0, 0.8]) / np.hypot(0.3, 0.8)
    assert found.normals is not None
    np.testing.assert_allclose(found.normals, np.tile(expected, (9, 1)), atol=1e-7)


@pytest.mark.parametrize("kind", ["faceVarying", "vertex", "uniform", "constant"])
def test_values_come_to_corners(here, tmp_path, kind):
    n = {"faceVarying": 7, "vertex": 5, "uniform": 2, "constant": 1}[kind]
    values = np.arange(2.0 * n).reshape(n, 2)
    more = f'    texCoord2f[] primvars:st = {listed(values)} (interpolation = "{kind}")\n'
    found = read_mesh(written(tmp_path, mesh(more=more)))
    order = {
        "faceVarying": [0, 1, 2, 0, 2, 3, 4, 5, 6],
        "vertex": [0, 1, 2, 0, 2, 3, 3, 2, 4],
        "uniform": [0] * 6 + [1] * 3,
        "constant": [0] * 9,
    }[kind]
    assert found.places is not None
    np.testing.assert_array_equal(found.places, values[order])


def test_several_prims_holes_and_what_is_left_out(here, tmp_path):
    hidden = mesh("hidden", more='    token visibility = "invisible"\n')
    guide = mesh("guide", more='    uniform token purpose = "guide"\n')
    holed = mesh("holed", more="    int[] holeIndices = [0]\n")
    text = mesh("a") + hidden + guide + holed
    assert corners(read_mesh(written(tmp_path, text))).shape == (4, 3, 3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (prim(), "has no visible meshes"),
        (mesh(counts=(4, 4)), "/m: faceVertexCounts add up to 8, and there are 7"),
        (mesh(indices=(0, 1, 2, 3, 3, 2, 9)), "/m: faceVertexIndices go from 0 to 9, and there"),
        (mesh(counts=(2, 2, 2, 1)), "has no triangles"),
        (mesh(points=[(float("nan"), 0, 0), *POINTS[1:]]), "vertex 0 is at"),
    ],
)
def test_what_is_no_mesh_is_refused(here, tmp_path, text, said):
    path = written(tmp_path, text)
    with pytest.raises(MeshError, match=re.escape(said)):
        MeshTable(file=str(path)).build()


def test_a_damaged_file_is_refused(tmp_path):
    path = tmp_path / "a.usda"
    path.write_text("#usda 1.0\ndef Mesh {")
    with pytest.raises(MeshError, match=r"a\.usda: usd-core cannot read it"):
        read_mesh(path)


def test_strands_and_mesh_of_one_file_stand_alike(device, tmp_path):
    """In one command; the mesh, below the strands with y up, hides the sky."""
    strands = np.array([(0.5, 0.2 * k, 0.0) for k in range(1, 5)])
    text = prim("hair", strands, (4,), widths=(0.05,))
    text += mesh(points=[(x * 4 - 1.5, 0, y * 4 - 2) for x, y, _ in POINTS], counts=(4,),
                 indices=(0, 3, 2, 1))  # fmt: skip
    path = written(tmp_path, text)
    command = ["render", str(path), "--size", "24x24"]
    said = CliRunner().invoke(app, [*command, "--spp", "2", "-o", str(tmp_path / "a.exr")])
    assert said.exit_code == 0, said.output
    assert np.isfinite(Image.load(tmp_path / "a.exr").rgb).all()
    scene = load_scene(path)
    (floor,) = scene.mesh.values()
    low = floor.build().triangles.bounds()[1][2]
    assert low == pytest.approx(0.0, abs=1e-6)
    assert scene.build_curves().points[:, 2].min() == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize(
    "more", ['    token visibility = "invisible"\n', '    uniform token purpose = "guide"\n']
)
def test_a_groom_without_visible_meshes_has_none_beside_it(tmp_path, more):
    strands = prim("hair", np.zeros((4, 3)), (4,), widths=(0.05,))
    assert not load_scene(written(tmp_path, strands + mesh(more=more))).mesh
    assert load_scene(written(tmp_path, strands + mesh())).mesh
