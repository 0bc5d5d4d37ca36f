"""The nearest guide of each strand, against scipy's tree and against all pairs."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from furcl.groom.grow import nearest as module
from furcl.groom.grow.nearest import nearest

SHAPES = [(1, 1, 3), (1, 500, 3), (500, 1, 6), (7, 3000, 1), (4000, 20_000, 3), (3000, 9000, 6)]


def cloud(kind, n, d, rng):
    """Points (n, d) float32 of a kind: even, in lumps, on a surface, or far from the origin."""
    points = rng.standard_normal((n, d))
    if kind == "lumps":
        points = 0.001 * points + rng.integers(0, 4, (n, d))
    elif kind == "surface":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    elif kind == "far":
        points += 1000.0
    return points.astype(np.float32)


@pytest.mark.parametrize("kind", ["even", "lumps", "surface", "far"])
@pytest.mark.parametrize(("m", "n", "d"), SHAPES)
def test_nearest_is_that_of_a_tree(kind, m, n, d):
    rng = np.random.default_rng([m, n, d])
    guides, points = cloud(kind, m, d, rng), cloud(kind, n, d, rng)
    distance, expected = KDTree(guides).query(points)
    found = nearest(guides, points)
    assert found.dtype == np.int64
    # A tree takes any of guides that are equally far.
    other = np.flatnonzero(found != expected)
    tied = np.linalg.norm(np.float64(guides[found[other]]) - points[other], axis=1)
    np.testing.assert_array_equal(tied, distance[other])
    assert len(other) <= 0.001 * n


@pytest.mark.parametrize("d", [1, 3, 6])
def test_first_of_equally_near_guides_is_taken(d):
    """Whole coordinates make many points equally far from several guides, without rounding."""
    rng = np.random.default_rng(d)
    guides = rng.integers(0, 5, (400, d)).astype(np.float32)
    points = rng.integers(0, 9, (5000, d)).astype(np.float32) / 2
    square = cdist(points, guides, "sqeuclidean")
    least = square.min(axis=1, keepdims=True)
    assert ((square == least).sum(axis=1) > 1).mean() > 0.4
    np.testing.assert_array_equal(nearest(guides, points), square.argmin(axis=1))


def test_equal_points_and_no_points():
    guides = np.zeros((300, 3), np.float32)
    np.testing.assert_array_equal(nearest(guides, np.ones((100_000, 3), np.float32)), 0)
    assert nearest(guides, np.zeros((0, 3), np.float32)).shape == (0,)


def test_float32_alone_would_decide_wrongly(monkeypatch):
    """The mutant without the comparison in float64 takes other guides."""
    rng = np.random.default_rng(1)
    guides, points = (cloud("lumps", n, 6, rng) for n in (3000, 9000))
    expected = KDTree(guides).query(points)[1]
    np.testing.assert_array_equal(nearest(guides, points), expected)
    monkeypatch.setattr(module, "ROUNDING", np.float32(-1.0))
    assert (nearest(guides, points) != expected).any()
