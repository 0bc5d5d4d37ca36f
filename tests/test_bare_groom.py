"""A picture of a groom file alone, and scenes that `furcl new` writes."""

import tomllib

import numpy as np
import pytest
from mesh_files import obj_text
from mesh_shapes import sphere
from typer.testing import CliRunner

from furcl.cli import app
from furcl.errors import SceneError
from furcl.groom.curves import Curves
from furcl.groom.formats import save_curves, suffixes
from furcl.groom.widths import question
from furcl.image.image import Image
from furcl.scene.from_groom import RADIUS_SHARE, material_override
from furcl.scene.read import load_scene


def ball(n=60, radius=0.01, k=5):
    """Strands that leave a ball of radius 1."""
    rng = np.random.default_rng(8)
    way = rng.normal(size=(n, 1, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    return Curves.from_arrays(way * np.linspace(1, 1.5, k)[:, None], radius)


def test_a_groom_is_a_scene(tmp_path):
    save_curves(ball(), tmp_path / "a.npz")
    scene = load_scene(tmp_path / "a.npz", spp=4, overrides=["curves.up_axis=y"])
    assert (scene.name, scene.render.spp) == ("a", 4)
    np.testing.assert_array_equal(
        scene.build_curves().points, ball().points[:, [0, 2, 1]] * [1, -1, 1]
    )


def test_without_radii(tmp_path, caplog):
    np.save(tmp_path / "a.npy", ball().points.reshape(60, 5, 3))
    curves = load_scene(tmp_path / "a.npy").build_curves()
    size = np.ptp(curves.points, axis=0).max()
    np.testing.assert_allclose(curves.radii, RADIUS_SHARE * size, rtol=1e-6)
    assert "has no radii; strands are given one of" in caplog.text
    given = load_scene(tmp_path / "a.npy", overrides=["curves.default_radius=0.5"]).build_curves()
    assert (given.radii == 0.5).all()


def test_materials():
    assert material_override("raccoon") == "fibre.preset=raccoon"
    assert material_override("chiang") == "fibre.model=chiang"
    with pytest.raises(SceneError, match=r"material 'hay' is not known; presets are .*models are"):
        material_override("hay")


@pytest.mark.parametrize(
    ("width", "factor"),
    [(1e-3, None), (9e-3, None), (2e-5, None), (0.04, 0.01), (0.4, 1e-3), (4e-6, 100.0)],
)
def test_widths_that_are_no_fibres(width, factor):
    """Of a groom of size 1."""
    curves = Curves.from_arrays([[[0, 0, 0], [0, 0, 1]]], width / 2)
    asked = question(curves)
    assert bool(asked) == (factor is not None)
    if factor is not None:
        assert f"--radius-scale {factor:g} " in asked


def test_a_picture_with_one_command(device, tmp_path):
    """It shows the groom, lit, on a sky that fills what is around."""
    save_curves(ball(300, 0.03), tmp_path / "a.ply")
    said = CliRunner().invoke(
        app,
        [
            "render",
            str(tmp_path / "a.ply"),
            "-o",
            str(tmp_path / "a.exr"),
            "--size",
            "32x32",
            "--spp",
            "4",
            "--material",
            "white",
            "--up",
            "y",
        ],
    )
    assert said.exit_code == 0, said.output
    image = Image.load(tmp_path / "a.exr")
    assert np.isfinite(image.rgb).all()
    assert image.rgb[10:22, 10:22].mean() > 0.01
    assert (tmp_path / "a.png").exists()


def test_material_of_a_scene_is_refused(tmp_path):
    said = CliRunner().invoke(
        app, ["render", "black_hair", "-o", str(tmp_path / "a.exr"), "--material", "white"]
    )
    assert said.exit_code == 2
    assert "fibre.preset=NAME" in said.output


@pytest.mark.parametrize("up", [None, "y"])
@pytest.mark.parametrize("with_mesh", [False, True])
def test_new(tmp_path, with_mesh, up):
    (tmp_path / 'odd "name').mkdir()
    groom = tmp_path / 'odd "name' / "a.hair"
    save_curves(ball(), groom)
    mesh = tmp_path / "ball.obj"
    mesh.write_text(obj_text(sphere(4, 1.0).corners))
    command = ["new", str(tmp_path / "s.toml"), "--groom", str(groom), "--material", "red"]
    command += ["--mesh", str(mesh)] if with_mesh else []
    command += ["--up", up] if up else []
    said = CliRunner().invoke(app, command)
    assert said.exit_code == 0, said.output
    scene = load_scene(tmp_path / "s.toml")
    curves = scene.build_curves()
    assert (curves.points[0] == ball().points[0]).all() == (up is None)
    document = tomllib.loads((tmp_path / "s.toml").read_text())
    assert document["fibre"] == {"preset": "red"}
    assert not document["curves"]["file"].startswith("/")
    if with_mesh:
        (table,) = scene.mesh.values()
        assert table.transform.rotate_deg[0] == (90.0 if up else 0.0)
    # Every key that is there as a comment is one.
    text = (tmp_path / "s.toml").read_text().replace("# sigma_ca", "sigma_ca")
    (tmp_path / "t.toml").write_text(text.replace("# beta", "beta").replace("# up_axis", "up_axis"))
    assert getattr(load_scene(tmp_path / "t.toml").curves, "up_axis", None) == "y"


def test_new_refuses(tmp_path):
    save_curves(ball(), tmp_path / "a.npz")
    groom = ["--groom", str(tmp_path / "a.npz")]
    (tmp_path / "old.toml").write_text("x")
    for name in ("old.toml", "a.json"):
        said = CliRunner().invoke(app, ["new", str(tmp_path / name), *groom])
        assert isinstance(said.exception, SceneError)
    said = CliRunner().invoke(
        app, ["new", str(tmp_path / "b.toml"), *groom, "--mesh", str(tmp_path / "no.obj")]
    )
    assert isinstance(said.exception, SceneError)
    assert "there is no such file" in str(said.exception)
    assert {p.name for p in tmp_path.iterdir()} == {"a.npz", "old.toml"}


def test_every_suffix_is_a_groom():
    from furcl.scene.from_groom import is_groom

    assert all(is_groom(__import__("pathlib").Path(f"a{suffix}".upper())) for suffix in suffixes())
