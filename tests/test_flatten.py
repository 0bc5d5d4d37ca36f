"""Cubic curves as polylines: nowhere farther from the curve than promised, and no idle points."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from furcl.errors import GroomError
from furcl.groom import flatten
from furcl.groom.flatten import LENGTH_SHARE, RADIUS_SHARE, Spans, flattened, places
from furcl.groom.formats.format import Strands

COUNTS = {"bezier": 10, "bspline": 9, "catmull-rom": 9}


def curve(basis, points, n_points=200):
    """Points of one nonperiodic curve, by scipy or by the definition of its basis."""
    k = len(points)
    if basis == "bspline":
        return BSpline(np.arange(k + 4), points, 3)(np.linspace(3, k, n_points))
    if basis == "bezier":
        t = np.linspace(0, 1, n_points)[:, None]
        parts = [points[i : i + 4] for i in range(0, k - 3, 3)]
        return np.concatenate(
            [
                (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t * t * (1 - t) * c + t**3 * d
                for a, b, c, d in parts
            ]
        )
    t = np.linspace(0, 1, n_points)[:, None]
    parts = []
    for i in range(1, k - 2):
        p, q = points[i], points[i + 1]
        m, n = (q - points[i - 1]) / 2, (points[i + 2] - p) / 2
        h = 2 * t**3 - 3 * t**2
        parts.append((1 + h) * p + (t**3 - 2 * t**2 + t) * m - h * q + (t**3 - t**2) * n)
    return np.concatenate(parts)


def distances(points, polyline):
    """From points to a polyline."""
    a, b = polyline[:-1], polyline[1:]
    way = b - a
    length_sq = np.maximum((way * way).sum(1), 1e-300)
    along = np.clip(np.einsum("nij,ij->ni", points[:, None] - a, way) / length_sq, 0, 1)
    nearest = a + along[..., None] * way
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(1)


def strands(points, radius, offsets=None):
    offsets = np.array([0, len(points)]) if offsets is None else offsets
    return Strands(points, radius, offsets, "test")


@pytest.mark.parametrize("radius", [1e-6, 0.004, 0.1])
@pytest.mark.parametrize("basis", COUNTS)
def test_within_the_tolerance_both_ways(basis, radius):
    """Measured: at most 0.98 of the tolerance, and not below 0.2 of it: points are not wasted."""
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.normal(size=(COUNTS[basis], 3)), axis=0)
    found = flattened(strands(points, radius), basis)
    true = curve(basis, points)
    bezier = Spans(np.array([0, len(points)]), basis).bezier(points)
    length = np.linalg.norm(np.diff(bezier, axis=1), axis=2).sum()
    tolerance = max(RADIUS_SHARE * radius, LENGTH_SHARE * length)
    line = found.points.astype(np.float64)
    worst = distances(true, line).max()
    assert 0.2 * tolerance < worst <= tolerance * (1 + 1e-3)
    middle = ((line[1:] + line[:-1]) / 2)[:: max(len(line) // 30, 1)]
    assert distances(middle, curve(basis, points, 1000)).max() <= tolerance * (1 + 1e-2)
    np.testing.assert_allclose(line[[0, -1]], true[[0, -1]], atol=1e-5)


def test_a_straight_curve_gets_no_points():
    points = np.linspace([0, 0, 0], [3, 6, 9], 10)
    assert len(flattened(strands(points, 0.01), "bezier").points) == 4
    assert len(flattened(strands(points, 0.01), "bspline").points) == 8


def test_radii_bend_too():
    points = np.linspace([0, 0, 0], [9, 0, 0], 4)
    radii = np.array([0.1, 0.1, 0.1, 1.0])
    found = flattened(strands(points, radii), "bezier")
    x, r = found.points[:, 0] / 9, np.asarray(found.radii)
    assert len(x) > 2
    np.testing.assert_allclose(r, 0.1 + 0.9 * x**3, atol=1e-6)
    t = np.linspace(0, 1, 200)
    assert np.abs(np.interp(t, x, r) - (0.1 + 0.9 * t**3)).max() <= RADIUS_SHARE * 1.0


@pytest.mark.parametrize("basis", ["bezier", "bspline", "catmull-rom"])
def test_in_parts_as_at_once(basis, monkeypatch):
    """Strands of any lengths, one longer than a part; values of points and of strands."""
    rng = np.random.default_rng(2)
    counts = 1 + 3 * rng.integers(1, 9, 40)
    counts[7] = 1 + 3 * 60
    offsets = np.concatenate([[0], np.cumsum(counts)])
    values = {"of points": rng.random(offsets[-1]), "of strands": rng.random((40, 3))}
    given = Strands(
        rng.normal(size=(offsets[-1], 3)), rng.random(offsets[-1]), offsets, "x", values
    )
    at_once = flattened(given, basis)
    monkeypatch.setattr(flatten, "AT_ONCE", 50)
    in_parts = flattened(given, basis)
    np.testing.assert_array_equal(in_parts.points, at_once.points)
    np.testing.assert_array_equal(in_parts.radii, at_once.radii)
    np.testing.assert_array_equal(in_parts.offsets, at_once.offsets)
    for name in values:
        np.testing.assert_array_equal(in_parts.attributes[name], at_once.attributes[name])
    assert np.shape(in_parts.attributes["of points"]) == (len(in_parts.points),)


@pytest.mark.parametrize("basis", ["bspline", "catmull-rom"])
def test_pinned_curves_reach_their_ends(basis):
    points = np.random.default_rng(1).normal(size=(6, 3))
    spans = Spans(np.array([0, 6]), basis, "pinned")
    assert spans.offsets.tolist() == [0, 5]
    bezier = spans.bezier(points)
    np.testing.assert_allclose(bezier[0, 0], points[0], atol=1e-14)
    np.testing.assert_allclose(bezier[-1, 3], points[-1], atol=1e-14)


@pytest.mark.parametrize("basis", COUNTS)
def test_periodic_curves_close_smoothly(basis):
    points = np.random.default_rng(1).normal(size=(9, 3))
    spans = Spans(np.array([0, 9]), basis, "periodic")
    assert spans.offsets[-1] == (3 if basis == "bezier" else 9)
    bezier = spans.bezier(points)
    np.testing.assert_allclose(bezier[0, 0], bezier[-1, 3], atol=1e-14)
    assert spans.varying_offsets[-1] == spans.offsets[-1]
    if basis != "bezier":
        np.testing.assert_allclose(
            bezier[0, 1] - bezier[0, 0], bezier[-1, 3] - bezier[-1, 2], atol=1e-14
        )


def test_values_of_points_and_of_ends_follow():
    points = np.cumsum(np.random.default_rng(5).normal(size=(14, 3)), axis=0)
    spans = Spans(np.array([0, 7, 14]), "bezier")
    bezier = spans.bezier(points)
    found = places(spans, [bezier], np.full((4, 4), 1e-3))
    np.testing.assert_array_equal(found.of(spans.bezier(points)), found.of(bezier))
    ends = np.array([0.0, 1.0, 2.0, 10.0, 11.0, 12.0])
    values = found.of(spans.bezier_of_ends(ends))
    first, second = values[: found.offsets[1]], values[found.offsets[1] :]
    assert first[[0, -1]].tolist() == [0.0, 2.0]
    assert second[[0, -1]].tolist() == [10.0, 12.0]
    assert (np.diff(first) > 0).all()


@pytest.mark.parametrize(
    ("basis", "wrap", "count", "message"),
    [
        ("bezier", "nonperiodic", 5, "strand 1 has 5 control points; .* has 4, 7, 10"),
        ("bspline", "nonperiodic", 3, "strand 1 has 3 control points; .* at least 4"),
        ("bspline", "pinned", 1, "at least 2"),
        ("bezier", "periodic", 4, "a multiple of 3"),
        ("catmull-rom", "periodic", 2, "at least 3"),
    ],
)
def test_numbers_of_control_points(basis, wrap, count, message):
    with pytest.raises(GroomError, match=message):
        Spans(np.cumsum([0, {"periodic": 6}.get(wrap, 4), count]), basis, wrap)
