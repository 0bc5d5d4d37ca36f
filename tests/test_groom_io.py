"""Reading and writing grooms in every format: options, paths, round trips and real files."""

import numpy as np
import pytest
from groom_files import (
    COLOURS,
    POINTS,
    THICKNESS,
    assert_same,
    good_arrays,
    hair_bytes,
    npz_bytes,
    written,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from furcl.errors import GroomError
from furcl.groom import formats
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves
from furcl.scene.read import decode_scene


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.hair", hair_bytes(flags=3, default_thickness=0)),
        ("a.npz", npz_bytes(**good_arrays(radii=None))),
    ],
)
def test_default_radius_and_scale(tmp_path, name, data):
    curves = load_curves(written(tmp_path, data, name), default_radius=0.5, radius_scale=3.0)
    np.testing.assert_array_equal(curves.radii, np.full(9, 1.5, np.float32))


def test_default_radius_does_not_replace_the_files_own(tmp_path):
    curves = load_curves(
        written(tmp_path, hair_bytes(flags=31)), default_radius=7.0, radius_scale=0.5
    )
    np.testing.assert_array_equal(curves.radii, THICKNESS / 4)
    np.testing.assert_array_equal(curves.colours, COLOURS)
    assert dict(curves.dropped) == {"transparency_values": 9}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"default_radius": 0.0}, "default_radius = 0; it must be positive"),
        ({"default_radius": float("nan")}, "default_radius = nan"),
        ({"radius_scale": -2.0}, "radius_scale = -2"),
        ({"radius_scale": float("inf")}, "radius_scale = inf"),
        ({"radius_scale": 1e-30}, "radius_scale = 1e-30.*strand 0, point 0: radius"),
    ],
)
def test_bad_options(tmp_path, options, message):
    with pytest.raises(GroomError, match=message):
        load_curves(written(tmp_path, hair_bytes()), **options)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("groom.hair", hair_bytes(thickness=THICKNESS * 0)),
        ("groom.npz", npz_bytes(**good_arrays(radii=THICKNESS * 0))),
    ],
)
def test_default_radius_replaces_radii_that_are_all_zero(tmp_path, name, data):
    path = written(tmp_path, data, name)
    np.testing.assert_array_equal(load_curves(path, 0.25).radii, np.full(9, 0.25))
    with pytest.raises(GroomError, match="--default-radius R"):
        load_curves(path)


@pytest.mark.parametrize("scale", [0.25, 8.0])
def test_scaled_tips_of_radius_zero_are_read_and_counted(tmp_path, scale):
    radii = THICKNESS.copy()
    radii[[2, 8]] = 0.0
    path = written(tmp_path, npz_bytes(**good_arrays(radii=radii)), "groom.npz")
    curves = load_curves(path, radius_scale=scale)
    assert curves.dropped["radii_below_1e-18"] == 2
    np.testing.assert_array_equal(curves.radii[3:8], radii[3:8] * np.float32(scale))


@pytest.mark.parametrize("name", ["missing.hair", "missing.npz", "folder.hair", "folder.npz"])
def test_unreadable_path(tmp_path, name):
    (tmp_path / "folder.hair").mkdir()
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(GroomError, match=f"{name}: cannot be read: .*Check the path"):
        load_curves(tmp_path / name)


def test_unknown_suffix(tmp_path):
    curves = Curves.from_arrays(POINTS, 0.1, [0, 9])
    with pytest.raises(GroomError, match=r"'\.abd' is no groom format .* \(\.data, .*: convert"):
        load_curves(tmp_path / "groom.abd")
    with pytest.raises(GroomError, match=r"'\.abc' .*Alembic.*Blender.*export USD"):
        load_curves(tmp_path / "groom.ABC")
    with pytest.raises(GroomError, match="'' is no groom format"):
        save_curves(curves, tmp_path / "groom")


def read_xyz(path, default_radius):
    """One strand, a point a line."""
    points = np.loadtxt(path)
    return Curves.from_arrays(points[None], default_radius or 0.5, source=str(path))


def write_xyz(curves, file, path):
    np.savetxt(file, curves.points)


@pytest.fixture
def xyz():
    """A format from outside, for the length of a test."""
    formats.register(".xyz", read_xyz, write_xyz)
    yield
    formats.unregister(".xyz")


def test_a_format_from_outside(xyz, tmp_path):
    curves = Curves.from_arrays([[[0, 0, 0], [0, 1, 0], [0, 2, 1]]], 0.5)
    save_curves(curves, tmp_path / "a.xyz")
    assert_same(load_curves(tmp_path / "a.xyz"), curves)
    scene = {
        "fibre": {"preset": "raccoon"},
        "environment": {"kind": "constant"},
        "curves": {"file": str(tmp_path / "a.xyz"), "default_radius": 0.25},
    }
    assert (decode_scene(scene).build_curves().radii == 0.25).all()
    formats.register(".xyz", read_xyz)
    with pytest.raises(GroomError, match=r"'\.xyz' is no groom format that furcl writes"):
        save_curves(curves, tmp_path / "a.xyz")


@pytest.mark.parametrize("suffix", [".hair", ".npz", "xyz", ".XYZ", ".a.b", "", "."])
def test_bad_suffixes_of_formats(suffix):
    with pytest.raises(GroomError, match="Choose another"):
        formats.register(suffix, read_xyz)
    with pytest.raises(GroomError, match="was not registered"):
        formats.unregister(suffix)
    assert formats.suffixes()[:2] == (".hair", ".npz")


def test_unwritable_folder(tmp_path):
    with pytest.raises(GroomError, match=r"cannot be written: .*Check the folder"):
        save_curves(Curves.from_arrays(POINTS, 0.1, [0, 9]), tmp_path / "missing" / "a.npz")


@st.composite
def grooms(draw):
    """Grooms with even or uneven strands, one or many radii, with or without colours."""
    counts = draw(st.lists(st.integers(2, 6), min_size=1, max_size=8))
    if draw(st.booleans()):
        counts = [counts[0]] * len(counts)
    n = sum(counts)
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    points = rng.normal(size=(n, 3)) * 10.0 ** draw(st.integers(-9, 9))
    radii = rng.random(n) + 1e-9 if draw(st.booleans()) else draw(st.floats(1e-15, 1e15))
    colours = rng.random((n, 3)) if draw(st.booleans()) else None
    return Curves.from_arrays(points, radii, np.cumsum([0, *counts]), colours=colours)


@pytest.mark.parametrize("suffix", [".hair", ".npz", ".HAIR"])
@settings(derandomize=True, deadline=None, max_examples=60)
@given(curves=grooms())
def test_round_trip_is_exact(tmp_path_factory, suffix, curves):
    path = tmp_path_factory.mktemp("round_trip") / f"groom{suffix}"
    save_curves(curves, path)
    assert_same(load_curves(path), curves)
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("name", "n_strands", "points_each", "radius_range"),
    [
        ("sintel_straight", 11400, 16, (3e-4, 3e-4)),
        ("sintel_curly", 11400, 61, (1.5e-5, 5e-5)),
        ("bear_fur", 48113, 4, (0.075, 0.075)),
        ("bunny_fur", 37227, 8, (9e-5, 6e-4)),
    ],
)
def test_real_grooms(shared_data, tmp_path, name, n_strands, points_each, radius_range):
    curves = load_curves(shared_data / "hair" / f"{name}.hair")
    assert curves.n_strands == n_strands
    assert (np.diff(curves.offsets) == points_each).all()
    assert dict(curves.dropped) == {}
    np.testing.assert_allclose([curves.radii.min(), curves.radii.max()], radius_range, rtol=1e-6)
    for suffix in (".hair", ".npz"):
        save_curves(curves, tmp_path / f"copy{suffix}")
        assert_same(load_curves(tmp_path / f"copy{suffix}"), curves)
