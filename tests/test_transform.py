"""Transforms of grooms, meshes and lamps."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from furcl.scene.transform import Transform


def transform(**keys):
    return msgspec.convert(keys, Transform)


def test_it_scales_then_turns_then_moves():
    placed = transform(scale=[1, 2, 3], rotate_deg=[20, -50, 130], translate=[4, 5, 6])
    points = np.random.default_rng(1).normal(size=(50, 3))
    turned = Rotation.from_euler("xyz", [20, -50, 130], degrees=True).apply(points * [1, 2, 3])
    np.testing.assert_allclose(placed.points(points), np.add(turned, [4, 5, 6]), atol=1e-13)
    np.testing.assert_allclose(placed.vectors(points), turned, atol=1e-13)


@pytest.mark.parametrize("scale", [[1, 2, 3], [-1, 2, 0.5]], ids=["stretched", "mirrored"])
def test_normals_stay_normal_and_outside(scale):
    """A sphere's normals are those of the ellipsoid it becomes: the gradient of its equation."""
    placed = transform(scale=scale, rotate_deg=[10, 20, 30], translate=[1, 0, 0])
    sphere = np.random.default_rng(2).normal(size=(50, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    normals = placed.normals(sphere)
    inside = placed.points(0.5 * sphere)
    assert (((placed.points(sphere) - inside) * normals).sum(axis=1) > 0.0).all()
    gradient = np.linalg.inv(placed.as_matrix()[:3, :3]).T @ sphere.T
    gradient = (gradient / np.linalg.norm(gradient, axis=0)).T
    np.testing.assert_allclose(normals, gradient, atol=1e-12)


def test_a_matrix_is_taken_as_it_is():
    rows = [[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]]
    placed = transform(matrix=rows)
    np.testing.assert_array_equal(placed.as_matrix(), rows)
    assert placed.uniform_scale() == 2.0
    assert not placed.is_identity
    assert transform().is_identity


@pytest.mark.parametrize("keys", [{"scale": [1, 1, 2]}, {"scale": [1, 1, 1.001]}])
def test_radii_need_one_scale(keys):
    with pytest.raises(ValueError, match="radii need one scale for all"):
        transform(**keys).uniform_scale()
    assert transform(scale=[2, -2, 2], rotate_deg=[1, 2, 3]).uniform_scale() == pytest.approx(2)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"scale": 0}, "no scale may be 0"),
        ({"scale": [1, 0, 1]}, "no scale may be 0"),
        ({"scale": 1e10}, "allowed is -1e\\+09 to 1e\\+09"),
        ({"matrix": [[1, 0, 0, 0]] * 3 + [[0, 0, 0, 1]]}, "no scale may be 0"),
        ({"matrix": [[1, 0, 0, 0]] * 4}, "its last row is"),
        (
            {"matrix": np.eye(4).tolist(), "scale": 2, "translate": [1, 0, 0]},
            "matrix is given beside scale, translate",
        ),
    ],
)
def test_bad_transforms_are_refused(keys, message):
    with pytest.raises(msgspec.ValidationError, match=message):
        transform(**keys)
