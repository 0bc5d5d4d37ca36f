"""Curves of pbrt scenes: bases, transformations, files in files, and bad scenes."""

import gzip

import numpy as np
import pytest
from scipy.interpolate import BSpline

from furcl.errors import GroomError
from furcl.groom.formats import load_curves, pbrt_tokens

POINTS = np.array([[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1]], float)
P = '"point3 P" [' + " ".join(map(str, POINTS.ravel().tolist())) + "]"
CURVE = f'Shape "curve" {P} "float width" 0.5\n'


def written(folder, text, name="a.pbrt"):
    path = folder / name
    data = text.encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


@pytest.mark.parametrize("block", [3, 1 << 20])
@pytest.mark.parametrize("name", ["a.pbrt", "a.pbrt.gz"])
def test_a_bezier_curve(tmp_path, monkeypatch, block, name):
    """Of pbrt-v3 and v4, with comments in odd places."""
    monkeypatch.setattr(pbrt_tokens, "BLOCK_LETTERS", block)
    text = '# of [ a "comment\n' + CURVE.replace("point3", "point").replace("[0", "[ # one\n0")
    curves = load_curves(written(tmp_path, text, name))
    np.testing.assert_array_equal(curves.points[[0, -1]], POINTS[[0, -1]])
    middle = POINTS[0] / 8 + 3 * POINTS[1] / 8 + 3 * POINTS[2] / 8 + POINTS[3] / 8
    assert np.abs(curves.points - middle).sum(axis=1).min() < 1e-6
    assert (curves.radii == 0.25).all()


@pytest.mark.parametrize("degree", [2, 3])
def test_bsplines(tmp_path, degree):
    rng = np.random.default_rng(4)
    points = np.cumsum(rng.normal(size=(7, 3)), axis=0)
    numbers = " ".join(map(repr, points.ravel().tolist()))
    text = (
        f'Shape "curve" "string basis" "bspline" "integer degree" [{degree}] '
        f'"point3 P" [{numbers}] "float width0" 0.02 "float width1" [0.01]'
    )
    curves = load_curves(written(tmp_path, text))
    spline = BSpline(np.arange(7 + degree + 1), points, degree)
    true = spline(np.linspace(degree, 7, 2000))
    distance = np.linalg.norm(curves.points[:, None] - true, axis=2)
    assert distance.min(axis=1).max() < 0.01
    np.testing.assert_allclose(curves.points[[0, -1]], true[[0, -1]], atol=1e-5)
    np.testing.assert_allclose(curves.radii[[0, -1]], [0.01, 0.005], rtol=1e-6)
    assert (np.diff(curves.radii) < 0).all()


def test_quadratic_bezier_is_its_cubic(tmp_path):
    text = 'Shape "curve" "integer degree" 2 "point3 P" [0 0 0 3 3 0 6 0 0] "float width" 0.01'
    curves = load_curves(written(tmp_path, text))
    x, y = curves.points[:, 0] / 6, curves.points[:, 1]
    np.testing.assert_allclose(y, 6 * x * (1 - x), atol=1e-6)


MOVES = {
    "Translate 1 2 3": lambda p: p + np.array([1, 2, 3]),
    "Scale 2 2 2": lambda p: 2 * p,
    "Rotate 90 0 0 1": lambda p: p[:, [1, 0, 2]] * [-1, 1, 1],
    "Transform [0 1 0 0 0 0 1 0 1 0 0 0 5 0 0 1]": lambda p: p[:, [2, 0, 1]] + [5, 0, 0],
    "Scale 2 2 2 Translate 1 0 0": lambda p: 2 * (p + np.array([1, 0, 0])),
    "Scale 9 9 9 Identity": lambda p: p,
    "AttributeBegin Scale 9 9 9 AttributeEnd": lambda p: p,
    'Scale 3 3 3 CoordinateSystem "a" Identity CoordSysTransform "a"': lambda p: 3 * p,
    "LookAt 0 0 5 0 0 0 0 1 0 Scale -1 1 1 WorldBegin": lambda p: p,
}


@pytest.mark.parametrize("moves", MOVES)
def test_transformations(tmp_path, moves):
    """Points move, and widths are scaled with them."""
    plain = load_curves(written(tmp_path, CURVE))
    moved = load_curves(written(tmp_path, f"{moves}\n{CURVE}"))
    expected = MOVES[moves](plain.points)
    np.testing.assert_allclose(moved.points, expected, atol=1e-6)
    scale = np.linalg.norm(expected[1] - expected[0]) / np.linalg.norm(
        plain.points[1] - plain.points[0]
    )
    np.testing.assert_allclose(moved.radii, 0.25 * scale, rtol=1e-6)


def test_segments_that_meet_are_a_strand(tmp_path):
    on = CURVE.replace("0.0 0.0 0.0", "1.0 1.0 1.0").replace("0.0 1.0 1.0", "2.0 2.0 2.0")
    thin = on.replace("width", "width1")
    assert load_curves(written(tmp_path, CURVE + on)).n_strands == 1
    assert load_curves(written(tmp_path, CURVE + thin)).n_strands == 2
    assert load_curves(written(tmp_path, CURVE + CURVE)).n_strands == 2


def test_files_in_files(tmp_path):
    (tmp_path / "geometry").mkdir()
    written(tmp_path / "geometry", "Translate 1 0 0\n" + CURVE, "hair.pbrt.gz")
    text = 'Shape "sphere" "float radius" 1\nAttributeBegin\nInclude "geometry/hair.pbrt.gz"\n'
    text += 'AttributeEnd\nObjectBegin "x"\n' + CURVE + "ObjectEnd\n" + CURVE
    curves = load_curves(written(tmp_path, text))
    assert curves.n_strands == 2
    assert dict(curves.dropped) == {"other_shapes": 1, "curves_of_objects": 1}
    assert curves.points[0].tolist() == [1, 0, 0]


BAD = {
    "no curve": ('Shape "sphere"', 'has no Shape "curve".* among 1 other'),
    "not pbrt": ("1 2 3", "line 1: '1' stands before any directive"),
    "cut off": ("\n\n" + CURVE[:40], r"line 3: .* is not opened and closed"),
    "a quote": ('\nShape "curve\n', 'line 2: .*"curve.* is not opened and closed'),
    "points": (CURVE.replace("[0.0 ", "["), "line 1: the curve has 11 numbers of points P"),
    "5 points": (CURVE.replace("[", "[1 2 3 "), "bezier curve of degree 3 has 1 more than"),
    "words": (CURVE.replace("[", "[x"), "line 1: .* are no numbers"),
    "degree": ("\n" + CURVE.rstrip() + ' "integer degree" 5', "line 2: a curve of degree 5"),
    "width": (CURVE.replace("0.5", "[1 2]"), "width = .* expected one number"),
    "no value": (CURVE.replace(" 0.5", ""), "line 1: .*width.* has no value"),
    "no type": (CURVE.replace('"float width"', '"width"'), "a parameter is declared as"),
    "matrix": ("Transform [1 2]\n" + CURVE, "line 1: Transform has 2 numbers instead of 16"),
    "end": ("AttributeEnd\n" + CURVE, "line 1: AttributeEnd without its beginning"),
    "missing": ('\nInclude "b.pbrt"', "line 2: Include 'b.pbrt': No such file"),
    "itself": ('Include "a.pbrt"', "files include each other 16 deep"),
    "infinite": ("Scale 1e40 1 1\n" + CURVE, "strand 0, point"),
    "numbers": ("Translate" + " 1" * 20000, "Translate has more than 10000 arguments"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_scenes(tmp_path, case):
    text, message = BAD[case]
    with pytest.raises(GroomError, match=message):
        load_curves(written(tmp_path, text))


def test_bad_gzip(tmp_path):
    path = written(tmp_path, CURVE, "a.pbrt.gz")
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(GroomError, match="cannot be unpacked"):
        load_curves(path)
    path.write_text(CURVE)
    with pytest.raises(GroomError, match="cannot be unpacked"):
        load_curves(path)


def test_a_basis_of_ones_own_is_refused(tmp_path):
    with pytest.raises(GroomError, match="basis = 'bspline': pbrt curves files say themselves"):
        load_curves(written(tmp_path, CURVE), basis="bspline")
