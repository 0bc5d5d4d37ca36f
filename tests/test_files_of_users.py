"""A picture with one command, of each file of the data folder and of each format."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from mesh_files import obj_text
from mesh_shapes import sphere
from typer.testing import CliRunner

from furcl.cli import app
from furcl.groom.curves import Curves
from furcl.groom.formats import FORMATS, save_curves, suffixes
from furcl.image.image import Image

GROOMS = (
    "curves/arnoldusd_test0189_linear_uv.usda", "curves/straight_500_mitsuba_bspline.txt",
    "hair/bear_fur.hair", "hair/bunny_fur.hair", "hair/sintel_curly.hair",
    "hair/sintel_straight.hair",
)  # fmt: skip
MESHES = ("mesh/bear_body.ply", "mesh/bunny.ply", "mesh/sintel_head.obj")
MAPS = ("env/forest.exr", "env/studio.exr", "env/sunrise.exr")
SMALL = ("--size", "16x16", "--spp", "1")


def picture(tmp_path: Path, *arguments: str) -> np.ndarray:
    """The picture of `furcl render ARGUMENTS`, whose size and samples are small."""
    out = tmp_path / "picture.exr"
    said = CliRunner().invoke(app, ["render", *arguments, "-o", str(out), *SMALL])
    assert said.exit_code == 0, said.output
    rgb = Image.load(out).rgb
    assert rgb.shape == (16, 16, 3)
    assert np.isfinite(rgb).all()
    return rgb


def found(folder: Path, name: str) -> str:
    """The path of a file, which may not be there."""
    if not (folder / name).exists():
        pytest.skip(f"{name} is not in the data folder")
    return str(folder / name)


@pytest.mark.slow
@pytest.mark.parametrize("name", GROOMS)
def test_grooms_of_the_data_folder(device, shared_data, tmp_path, name):
    """The middle, where the groom is, differs from the sky around it."""
    if name.endswith("usda"):
        pytest.importorskip("pxr", reason="usd-core is an extra")
    basis = ["--set", "curves.basis=bspline"] if "bspline" in name else []
    rgb = picture(tmp_path, found(shared_data, name), *basis)
    empty = picture(tmp_path, found(shared_data, name), *basis, "--set", "curves.radius_scale=1e-3")
    assert np.abs(rgb - empty)[4:12, 4:12].mean() > 0.01 * empty.mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", MESHES)
def test_meshes_of_the_data_folder(device, shared_data, tmp_path, name):
    """Beside a groom that is there; a mesh hides the sky."""
    save_curves(Curves.from_arrays(np.array([[[0, 0, 0], [0, 0, 1.0]]]), 1e-3), tmp_path / "a.npz")
    mesh = ("--set", f"mesh.body.file={found(shared_data, name)}")
    rgb = picture(tmp_path, str(tmp_path / "a.npz"), *mesh)
    assert np.abs(rgb - picture(tmp_path, str(tmp_path / "a.npz"))).max() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", MAPS)
def test_maps_of_the_data_folder(device, shared_data, tmp_path, name):
    light = (
        "--set", "environment.kind=image", "--set",
        f"environment.file={found(shared_data, name)}",
    )  # fmt: skip
    assert picture(tmp_path, "single_fibre", *light).mean() > 0.0


def test_the_data_folder_has_no_other_files(shared_data):
    """None that the tests above would leave out."""
    there = {
        str(path.relative_to(shared_data))
        for folder in ("curves", "hair", "mesh", "env")
        for path in (shared_data / folder).glob("*")
    }
    assert there <= {*GROOMS, *MESHES, *MAPS}


def made(path: Path) -> None:
    """A ball of strands in a format that furcl may not write."""
    rng = np.random.default_rng(8)
    way = rng.normal(size=(300, 1, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    points = (way * np.linspace(1, 1.5, 4)[:, None]).astype("<f4")
    if path.suffix in suffixes(written=True):
        save_curves(Curves.from_arrays(points, 0.03), path)
    elif path.suffix == ".npy":
        np.save(path, points)
    elif path.suffix == ".data":
        head, count = np.array([300], "<i4").tobytes(), np.array([4], "<i4").tobytes()
        path.write_bytes(head + b"".join(count + strand.tobytes() for strand in points))
    elif path.suffix == ".tfx":
        numbers = np.zeros(40, "<u4")
        numbers[:1].view("<f4")[:] = 4.0
        numbers[1:4] = 300, 4, 160
        positions = np.concatenate([points, np.ones((300, 4, 1), "<f4")], axis=2)
        path.write_bytes(numbers.tobytes() + positions.astype("<f4").tobytes())
    else:
        shapes = "".join(
            'Shape "curve" "point3 P" ['
            + " ".join(f"{x:.6g}" for x in strand.ravel())
            + '] "float width" 0.06\n'
            for strand in points
        )
        text = f"WorldBegin\n{shapes}".encode()
        path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)


@pytest.mark.parametrize("suffix", [s for form in FORMATS for s in form.suffixes])
def test_every_format(device, tmp_path, suffix):
    """The middle of the picture is not the sky that is around."""
    if suffix.startswith(".usd"):
        pytest.importorskip("pxr", reason="usd-core is an extra")
    path = tmp_path / f"groom{suffix}"
    made(path)
    given = ("--set", "curves.default_radius=0.03", "--set", "curves.radius_scale=1")
    basis = ("--set", "curves.basis=bspline") if suffix == ".txt" else ()
    rgb = picture(tmp_path, str(path), *given, *basis)
    thin = picture(tmp_path, str(path), "--set", "curves.default_radius=0.03", *basis,
                   "--set", "curves.radius_scale=1e-3")  # fmt: skip
    assert np.abs(rgb - thin)[4:12, 4:12].mean() > 0.01 * thin.mean()


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_every_mesh_format(device, tmp_path, suffix):
    import trimesh

    made(tmp_path / "a.npz")
    mesh = tmp_path / f"mesh{suffix}"
    corners = sphere(8, 0.9).corners
    if suffix == ".obj":
        mesh.write_text(obj_text(corners))
    else:
        faces = np.arange(corners.size // 3).reshape(-1, 3)
        trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False).export(mesh)
    thin = ("--set", "curves.radius_scale=1e-3")
    rgb = picture(tmp_path, str(tmp_path / "a.npz"), *thin, "--set", f"mesh.body.file={mesh}")
    without = picture(tmp_path, str(tmp_path / "a.npz"), *thin)
    assert np.abs(rgb - without)[6:10, 6:10].mean() > 0.05 * without.mean()
