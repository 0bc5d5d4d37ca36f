"""All groom formats: their page, and what each keeps on the way out and in again."""

import importlib.util
import subprocess
import sys

import make_formats
import numpy as np
import pytest
from groom_files import assert_same
from typer.testing import CliRunner

from furcl.cli import app
from furcl.errors import GroomError
from furcl.groom.curves import Curves
from furcl.groom.formats import FORMATS, load_curves, save_curves, suffixes
from furcl.groom.orient import scaled, z_up
from furcl.groom.units import Units

USD = pytest.mark.skipif(not importlib.util.find_spec("pxr"), reason="usd-core is an extra")
# One of USD's, whose reading takes a process: tests/test_usd.py has the others.
WRITTEN = [
    pytest.param(suffix, marks=[USD] * (suffix == ".usdc"))
    for suffix in suffixes(written=True)
    if suffix not in (".usd", ".usda")
]


def test_the_page_is_current():
    assert make_formats.PAGE.read_text(encoding="utf-8") == make_formats.page()


def test_every_suffix_is_of_one_format():
    of_all = [suffix for form in FORMATS for suffix in form.suffixes]
    assert len(of_all) == len(set(of_all))


@pytest.fixture(scope="module")
def curves():
    """Two strands with values of points and strands."""
    rng = np.random.default_rng(2)
    return Curves.from_arrays(
        rng.normal(size=(7, 3)).astype(np.float32),
        rng.random(7).astype(np.float32),
        [0, 3, 7],
        colours=rng.random((7, 3)),
        attributes={"melanin": rng.random(2), "wetness": rng.random(7), "dye": rng.random((7, 3))},
    )


@pytest.mark.parametrize("source", WRITTEN)
@pytest.mark.parametrize("target", WRITTEN)
def test_convert(curves, source, target, tmp_path):
    """From every written format to every other, by the command."""
    save_curves(curves, tmp_path / f"a{source}")
    said = CliRunner().invoke(
        app, ["convert", str(tmp_path / f"a{source}"), str(tmp_path / f"b{target}")]
    )
    assert said.exit_code == 0, said.output
    found = load_curves(tmp_path / f"b{target}")
    np.testing.assert_array_equal(found.points, curves.points)
    np.testing.assert_array_equal(found.radii, curves.radii)
    np.testing.assert_array_equal(found.offsets, curves.offsets)


KEPT = {".npz": {"colours", "melanin", "wetness", "dye"}, ".hair": {"colours"}, ".txt": set()}
KEPT[".ply"] = KEPT[".usdc"] = KEPT[".npz"]


@pytest.mark.parametrize("suffix", WRITTEN)
def test_values_that_have_a_place_are_kept(curves, suffix, tmp_path, caplog):
    save_curves(curves, tmp_path / f"a{suffix}")
    found = load_curves(tmp_path / f"a{suffix}")
    kept = KEPT[suffix]
    assert set(found.attributes) == kept
    for name in kept:
        np.testing.assert_array_equal(found.attributes[name], curves.attributes[name])
    for name in set(curves.attributes) - kept:
        assert name in caplog.text


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_an_axis_becomes_up(axis):
    """Without a mirror, exactly."""
    points = np.eye(3, dtype=np.float32)
    curves = Curves.from_arrays(points, 0.1, [0, 3])
    turned = z_up(curves, axis).points
    np.testing.assert_array_equal(turned["xyz".index(axis)], [0, 0, 1])
    assert np.linalg.det(turned) == pytest.approx(1.0)
    assert z_up(curves).units.up_axis is None
    with pytest.raises(GroomError, match="up axis = 'w'"):
        z_up(curves, "w")


def test_the_file_says_what_is_up(curves):
    import dataclasses

    said = dataclasses.replace(curves, units=Units(0.01, "y"))
    np.testing.assert_array_equal(z_up(said).points, z_up(curves, "y").points)
    np.testing.assert_array_equal(z_up(said, "z").points, curves.points)
    assert z_up(said).units == Units(0.01, "z")
    doubled = scaled(said, 2.0)
    np.testing.assert_array_equal(doubled.points, 2 * curves.points)
    np.testing.assert_array_equal(doubled.radii, 2 * curves.radii)
    assert doubled.units == Units(0.005, "y")
    assert_same(scaled(curves, 1.0), curves)
    with pytest.raises(GroomError, match="scale = 0"):
        scaled(curves, 0)


def test_info_says_units_and_convert_scales(curves, tmp_path):
    save_curves(curves, tmp_path / "a.npz")
    run = CliRunner().invoke
    said = run(app, ["info", str(tmp_path / "a.npz")])
    assert "unit                 not in the file, up not in the file" in said.output
    options = ["--scale", "0.5", "--up", "y", "--radius-scale", "4"]
    run(app, ["convert", str(tmp_path / "a.npz"), str(tmp_path / "b.ply"), *options])
    found = load_curves(tmp_path / "b.ply")
    np.testing.assert_array_equal(found.points, 0.5 * curves.points[:, [0, 2, 1]] * [1, -1, 1])
    np.testing.assert_array_equal(found.radii, 2 * curves.radii)


def test_a_readers_libraries_wait_until_they_are_needed():
    code = "import sys, furcl.groom.formats; print({'plyfile', 'pxr'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
