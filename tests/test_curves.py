"""Curves: what cleaning keeps, drops and refuses."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from furcl.errors import GroomError
from furcl.groom.curves import Curves


def three_strands():
    """Strands of 3, 2 and 4 distinct points with distinct radii."""
    points = np.cumsum(np.arange(27, dtype=np.float32).reshape(9, 3) % 5 + 1, axis=0)
    return points, np.linspace(0.1, 0.9, 9, dtype=np.float32), np.array([0, 3, 5, 9])


def test_clean_groom_is_unchanged():
    points, radii, offsets = three_strands()
    curves = Curves.from_arrays(points, radii, offsets)
    np.testing.assert_array_equal(curves.points, points)
    np.testing.assert_array_equal(curves.radii, radii)
    np.testing.assert_array_equal(curves.offsets, offsets)
    assert (curves.n_strands, curves.n_points, curves.n_segments) == (3, 9, 6)
    assert (curves.points.dtype, curves.radii.dtype) == (np.float32, np.float32)
    assert curves.offsets.dtype == np.int64
    assert curves.n_bytes == 9 * 16 + 4 * 8
    assert dict(curves.dropped) == {}


@pytest.mark.parametrize("name", ["points", "radii", "offsets"])
def test_arrays_are_read_only_but_the_callers_are_not(name):
    points, radii, offsets = three_strands()
    curves = Curves.from_arrays(points, radii, offsets)
    with pytest.raises(ValueError, match="read-only"):
        getattr(curves, name)[0] = 1
    assert points.flags.writeable
    assert radii.flags.writeable
    assert offsets.flags.writeable


@pytest.mark.parametrize(
    ("form", "name"),
    [
        (form, name)
        for form in ("flat", "equal strands", "memory view", "parts of one array")
        for name in ("points", "radii", "offsets", "colours")
        if (form, name) != ("equal strands", "offsets")
    ],
)
def test_what_the_caller_writes_later_does_not_reach_the_groom(form, name):
    given: dict[str, Any]
    if form == "parts of one array":
        block = np.linspace(0.1, 1.0, 63, dtype=np.float32)
        given = {"points": block[:27].reshape(9, 3), "radii": block[27:36]}
        given |= {"colours": block[36:].reshape(9, 3), "offsets": np.array([0, 4, 9])}
    else:
        given = dict(zip(("points", "radii", "offsets"), three_strands(), strict=True))
        given["colours"] = np.linspace(0.0, 1.0, 27, dtype=np.float32).reshape(9, 3)
    if form == "equal strands":
        given = {k: v.reshape(3, 3, *v.shape[1:]) for k, v in given.items() if k != "offsets"}
    passed: dict[str, Any] = {
        k: memoryview(v) if form == "memory view" else v for k, v in given.items()
    }
    curves = Curves.from_arrays(**passed)
    before = getattr(curves, name).copy()
    given[name][...] = 7
    np.testing.assert_array_equal(getattr(curves, name), before)


@pytest.mark.parametrize(
    "copied",
    [copy.copy, copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))],
    ids=["copy", "deepcopy", "pickle"],
)
@pytest.mark.parametrize("coloured", [True, False])
def test_grooms_are_copied_and_pickled(copied, coloured):
    points, radii, offsets = three_strands()
    radii[4] = 0.0
    colours = points / points.max() if coloured else None
    curves = Curves.from_arrays(points, radii, offsets, colours=colours)
    again = copied(curves)
    assert dict(again.dropped) == dict(curves.dropped) == {"radii_below_1e-18": 1}
    for name in ("points", "radii", "offsets", "colours"):
        array = getattr(again, name)
        np.testing.assert_array_equal(array, getattr(curves, name))
        assert array is None or not array.flags.writeable


@pytest.mark.parametrize("name", ["points", "radii", "offsets", "colours"])
@pytest.mark.parametrize("values", [[[1.0], [1.0, 2.0]], "three", [None, {}]])
def test_what_is_no_array_is_refused(name, values):
    points, radii, offsets = three_strands()
    given: dict[str, Any] = {"points": points, "radii": radii, "offsets": offsets, name: values}
    with pytest.raises(GroomError, match=f"curves: {name} "):
        Curves.from_arrays(**given)


def test_scalar_radius_and_other_number_types():
    points, _, offsets = three_strands()
    curves = Curves.from_arrays(points.astype(np.float64), 0.25, offsets.astype(np.uint32))
    np.testing.assert_array_equal(curves.radii, np.full(9, 0.25, np.float32))
    np.testing.assert_array_equal(curves.points, points)


@pytest.mark.parametrize("scalar", [True, False])
@pytest.mark.parametrize("coloured", [True, False])
def test_strands_of_equally_many_points(rng, scalar, coloured):
    points = rng.normal(size=(4, 3, 3))
    radii = 0.25 if scalar else rng.uniform(0.1, 0.2, (4, 3))
    colours = rng.uniform(size=(4, 3, 3)) if coloured else None
    curves = Curves.from_arrays(points, radii, colours=colours)
    np.testing.assert_array_equal(curves.points, points.reshape(12, 3).astype(np.float32))
    np.testing.assert_array_equal(curves.radii, np.float32(np.broadcast_to(radii, (4, 3)).ravel()))
    assert curves.offsets.tolist() == [0, 3, 6, 9, 12]
    assert (curves.colours is None) == (colours is None)
    if colours is not None:
        np.testing.assert_array_equal(curves.colours, np.float32(colours.reshape(12, 3)))


def test_repr_is_a_short_line():
    curves = Curves.from_arrays(*three_strands())
    assert repr(curves) == "Curves(3 strands, 9 points, radii 0.1 to 0.9)"
    curves = Curves.from_arrays(np.tile(np.eye(3)[:2], (100_000, 1, 1)), 0.1)
    assert repr(curves) == "Curves(100000 strands, 200000 points, radii 0.1 to 0.1)"


def test_segment_vertices():
    curves = Curves.from_arrays(*three_strands())
    assert curves.segment_vertices().tolist() == [0, 1, 3, 5, 6, 7]
    assert curves.segment_vertices().dtype == np.int32


def test_bounds_hold_every_sphere_around_a_point():
    curves = Curves.from_arrays([[0, 0, 0], [4, 1, -2]], [0.5, 0.25], [0, 2])
    lo, hi = curves.bounds()
    assert lo.tolist() == [-0.5, -0.5, -2.25]
    assert hi.tolist() == [4.25, 1.25, 0.5]


def test_repeated_points_are_dropped_and_counted():
    points, radii, offsets = three_strands()
    index = [0, 0, 1, 2, 3, 4, 4, 4, 5, 6, 7, 8, 8]
    curves = Curves.from_arrays(
        points[index], radii[index], [0, 4, 8, 13], colours=points[index] / 100
    )
    np.testing.assert_array_equal(curves.points, points)
    np.testing.assert_array_equal(curves.radii, radii)
    np.testing.assert_array_equal(curves.offsets, offsets)
    np.testing.assert_array_equal(curves.colours, points / np.float32(100))
    assert dict(curves.dropped) == {"zero_length_segments": 4}


@pytest.mark.parametrize("collapsed", [0, 1, 2])
def test_strand_of_one_repeated_point_is_dropped_and_counted(collapsed):
    points, radii, offsets = three_strands()
    points[offsets[collapsed] : offsets[collapsed + 1]] = 7.0
    curves = Curves.from_arrays(points, radii, offsets)
    counts = np.diff(offsets)
    assert np.diff(curves.offsets).tolist() == np.delete(counts, collapsed).tolist()
    assert not (curves.points == 7.0).all(axis=1).any()
    assert dict(curves.dropped) == {
        "zero_length_segments": counts[collapsed] - 1,
        "collapsed_strands": 1,
    }


def test_equal_points_of_neighbouring_strands_are_kept():
    curves = Curves.from_arrays([[0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]], 0.1, [0, 2, 4])
    assert curves.n_points == 4
    assert dict(curves.dropped) == {}


def test_dropped_counts_of_the_caller_are_kept():
    curves = Curves.from_arrays(*three_strands(), dropped={"transparency_values": 9, "others": 0})
    assert dict(curves.dropped) == {"transparency_values": 9}


def test_radii_of_zero_are_as_thin_as_can_be_and_counted():
    points, radii, offsets = three_strands()
    radii[[2, 4]] = 0.0, 1e-30
    curves = Curves.from_arrays(points, radii, offsets)
    assert curves.radii[[2, 4]].tolist() == [np.float32(1e-18)] * 2
    assert dict(curves.dropped) == {"radii_below_1e-18": 2}
    assert (
        radii[[2, 4]] == np.array([0.0, 1e-30], radii.dtype)
    ).all()  # the caller's are left alone


def changed(vertex=None, value=None, **arrays):
    """Arguments of from_arrays with one point, or whole arrays, replaced."""
    points, radii, offsets = three_strands()
    if vertex is not None:
        points[vertex] = value
    return {"points": points, "radii": radii, "offsets": offsets, **arrays}


def changed_radius(vertex, value):
    arguments = changed()
    arguments["radii"][vertex] = value
    return arguments


REFUSED = {
    "nan point": (changed(4, (0, np.nan, 0)), r"strand 1, point 1 is \(0, nan, 0\).*finite"),
    "infinite point": (changed(8, (0, 0, -np.inf)), r"strand 2, point 3 is \(0, 0, -inf\)"),
    "huge point": (changed(0, (2e18, 0, 0)), r"strand 0, point 0 is \(2e\+18.*at most 1e\+18"),
    "beyond float32": (
        changed(points=[[0, 0, 0], [1e300, 0, 0]], radii=[1, 1], offsets=[0, 2]),
        r"strand 0, point 1 is \(inf, 0, 0\)",
    ),
    "negative radius": (changed_radius(2, -0.5), "strand 0, point 2: radius -0.5"),
    "nan radius": (changed_radius(3, np.nan), "strand 1, point 0: radius nan; .*finite"),
    "infinite radius": (changed_radius(3, np.inf), "strand 1, point 0: radius inf"),
    "zero scalar radius": (changed(radii=0.0), "strand 0, point 0: radius 0; .*9 such points"),
    "one point": (changed(offsets=[0, 3, 4, 9]), "strand 1 has 1 point; .*at least 2"),
    "no points in a strand": (changed(offsets=[0, 3, 3, 9]), "strand 1 has 0 points"),
    "no strands": (changed(offsets=[0]), "empty"),
    "no offsets": (changed(offsets=np.zeros(0, int)), "empty"),
    "no points": (changed(points=np.zeros((0, 3)), radii=[], offsets=[0]), "empty"),
    "all collapsed": (changed(points=np.ones((9, 3))), "empty: all points"),
    "first offset": (changed(offsets=[1, 5, 9]), "run from 1 to 9; they must run from 0 .* 9"),
    "last offset": (changed(offsets=[0, 5, 8]), "run from 0 to 8"),
    "decreasing offsets": (changed(offsets=[0, 5, 3, 9]), "strand 1 ends before it begins"),
    "real offsets": (changed(offsets=[0.0, 9.0]), "offsets has .* float64; expected .* integers"),
    "huge offset": (changed(offsets=np.array([0, 2**64 - 1], np.uint64)), "18446744073709551615"),
    "flat points": (changed(points=np.zeros(27)), r"points has shape \(27,\); expected \(N, 3\)"),
    "no offsets of strands": (
        {"points": np.ones((4, 3)), "radii": 1.0},
        r"no offsets, and points of shape \(4, 3\).*Give offsets, or points \(S, K, 3\)",
    ),
    "flat strands": (
        {"points": np.ones((4, 3, 2)), "radii": 1.0},
        r"no offsets, and points of shape \(4, 3, 2\)",
    ),
    "strands and offsets": (
        {"points": np.ones((4, 3, 3)), "radii": 1.0, "offsets": [0, 3, 6, 9, 12]},
        r"offsets run from 0 to 12; .* the number of points, 3",  # of each of four time steps
    ),
    "radii of strands": (
        {"points": np.ones((4, 3, 3)), "radii": np.ones(12)},
        r"radii has shape \(12,\); expected \(4, 3\)",
    ),
    "colours of strands": (
        {"points": np.ones((4, 3, 3)), "radii": 1.0, "colours": np.ones((4, 2))},
        r"colours has shape \(4, 2\); expected \(12, 3\) of points or \(4, 3\) of strands",
    ),
    "no strands of points": ({"points": np.ones((0, 3, 3)), "radii": 1.0}, "empty"),
    "strands of one point": (
        {"points": np.ones((4, 1, 3)), "radii": 1.0},
        "strand 0 has 1 point; .*at least 2",
    ),
    "text points": (changed(points=[["a", "b", "c"]] * 9), "points has type <U1; .*real numbers"),
    "radii a strand": (changed(radii=[1, 1, 1]), r"radii has shape \(3,\); expected \(9,\)"),
    "colour shape": (changed(colours=np.zeros((4, 3))), r"colours has shape \(4, 3\)"),
    "scalar colours": (changed(colours=np.zeros(9)), r"colours has shape \(9,\)"),
    "colour nan": (changed(colours=np.full((9, 3), np.nan)), "strand 0, point 0: colours is not f"),
    "attribute of strands nan": (
        changed(attributes={"age": np.array([0.0, np.inf, 0.0])}),
        "strand 1: age is not finite",
    ),
    "attribute shape": (
        changed(attributes={"age": np.zeros(5)}),
        r"age has shape \(5,\); expected .*, or \(9,\) or \(3,\)",
    ),
    "attribute name": (changed(attributes={"radius": np.zeros(9)}), "'radius': that name has"),
    "too many points": (
        changed(points=np.broadcast_to(np.float32(0), (2**31, 3)), radii=1.0),
        "2147483648 points; at most 2147483647",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unusable_arrays_are_refused_with_the_place(case):
    arguments, message = REFUSED[case]
    with pytest.raises(GroomError, match=message) as caught:
        Curves.from_arrays(**arguments, source="some/file.hair")
    assert str(caught.value).startswith("some/file.hair: ")
