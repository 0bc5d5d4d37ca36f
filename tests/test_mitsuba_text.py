"""Mitsuba's text of curves: what is taken as a strand, blocks, and bad files."""

import numpy as np
import pytest

from furcl.errors import GroomError
from furcl.groom.formats import load_curves, text_rows

TEXT = """\
0 0 0 .5
0 0 1 .25

1 0 0 1e-1
1 1 0 .1
1 1 1 .1
"""
POINTS = [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 1, 0], [1, 1, 1]]
RADII = np.array([0.5, 0.25, 0.1, 0.1, 0.1], np.float32)


def written(folder, text):
    path = folder / "a.txt"
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        TEXT,
        TEXT.replace("\n", "\r\n"),
        TEXT.replace(" ", "\t  "),
        "\n\n" + TEXT.replace("\n\n", "\n \n\n"),
        TEXT + "\n\n\n",
        TEXT.rstrip("\n"),
    ],
    ids=["plain", "CR LF", "tabs", "empty lines", "at the end", "no last line break"],
)
@pytest.mark.parametrize("block", [1, 7, 1 << 20])
def test_strands(tmp_path, monkeypatch, text, block):
    monkeypatch.setattr(text_rows, "BLOCK_BYTES", block)
    curves = load_curves(written(tmp_path, text))
    np.testing.assert_array_equal(curves.points, POINTS)
    np.testing.assert_array_equal(curves.radii, RADII)
    np.testing.assert_array_equal(curves.offsets, [0, 2, 5])


def test_without_radii(tmp_path):
    """As the hair shape of Mitsuba 0.6 has it."""
    text = "0 0 0\n0 0 1\n\n1 0 0\n1 0 2\n"
    with pytest.raises(GroomError, match=r"x y z and no radius.*--default-radius"):
        load_curves(written(tmp_path, text))
    assert (load_curves(written(tmp_path, text), 0.25).radii == 0.25).all()


def test_control_points(tmp_path):
    """Of a uniform cubic B-spline, which starts at (P0 + 4 P1 + P2) / 6."""
    points = np.array([[0, 0, 0], [0, 0, 6], [0, 6, 6], [6, 6, 6]], float)
    text = "\n".join(f"{x} {y} {z} 0.1" for x, y, z in points)
    curves = load_curves(written(tmp_path, text), basis="bspline")
    np.testing.assert_allclose(curves.points[[0, -1]], [[0, 1, 5], [1, 5, 6]], rtol=1e-6)
    assert curves.n_points > 4
    np.testing.assert_allclose(curves.radii, 0.1, rtol=1e-6)
    with pytest.raises(
        GroomError, match=r"strand 0 has 4 control points; .*multiple of 3|3 a span"
    ):
        load_curves(written(tmp_path, text + "\n0 0 0 1"), basis="bezier")
    with pytest.raises(GroomError, match="basis = 'nurbs'"):
        load_curves(written(tmp_path, text), basis="nurbs")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0 0 1\n0 0\n", "line 2 holds 2 numbers, and lines before hold 4"),
        ("0 0 0 1 5\n", "line 1 holds 5 numbers; a line holds x y z radius"),
        ("0 0 0 1\n\n0 0 x 1\n", "line 3: 'x' is no number"),
        ("0 0 0 1\n0,0,0,1\n", "line 2: '0,0,0,1' is no number"),
        ("# a comment\n", "line 1: '#' is no number"),
        ("\n \n", "the groom is empty"),
        ("0 0 0 1\n\n1 0 0 1\n2 0 0 1", "strand 0 has 1 point"),
        ("0 0 0 1\n0 0 nan 1\n", "strand 0, point 1 is .*nan"),
        ("0 0 0 -1\n0 0 1 1\n", "strand 0, point 0: radius -1"),
        ("0 0 0 0\n0 0 1 0\n", "its radii are all 0"),
        ("1 " * 40000, "line 1 has more than 65536 letters"),
    ],
)
@pytest.mark.parametrize("block", [5, 1 << 20])
def test_bad_files(tmp_path, monkeypatch, text, message, block):
    monkeypatch.setattr(text_rows, "BLOCK_BYTES", block if len(text) < 1000 else 1 << 15)
    with pytest.raises(GroomError, match=message):
        load_curves(written(tmp_path, text))


def test_the_shared_groom(shared_data):
    path = shared_data / "curves/straight_500_mitsuba_bspline.txt"
    curves = load_curves(path)
    assert (curves.n_strands, curves.n_points) == (500, 8000)
    assert load_curves(path, basis="bspline").n_strands == 500
