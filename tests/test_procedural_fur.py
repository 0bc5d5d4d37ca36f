"""Fur and straight fibres: surfaces, maps, combing, undercoat."""

import numpy as np
import pytest
from groom_shapes import PLAIN_FUR, arc_lengths, strands_of

from furcl.groom.grow import body_of, fibre, fur


@pytest.mark.parametrize("bend_deg", [0, 120])
def test_fur_stays_on_the_sphere(bend_deg):
    centre = (1.0, 2.0, -3.0)
    curves = fur(n_strands=5000, centre=centre, sphere_radius=0.7, lean_deg=80, bend_deg=bend_deg)
    level = np.linalg.norm(strands_of(curves) - centre, axis=2) / 0.7
    np.testing.assert_allclose(level[:, 0], 1.0, atol=1e-6)
    assert level[:, 1:].min() > 1.0


def test_fur_stays_on_the_patch():
    curves = fur(n_strands=5000, surface="patch", patch_size=(3, 1), centre=(1, 2, 3), bend_deg=120)
    points = strands_of(curves)
    assert (points[:, 0, 2] == 3.0).all()
    assert points[:, 1:, 2].min() > 3.0
    assert points[:, 0, 0].min() == pytest.approx(-0.5, abs=0.01)
    assert points[:, 0, 0].max() == pytest.approx(2.5, abs=0.01)
    assert points[:, 0, 1].min() == pytest.approx(1.5, abs=0.01)
    assert points[:, 0, 1].max() == pytest.approx(2.5, abs=0.01)


def test_strands_follow_the_comb():
    curves = fur(
        n_strands=2000, surface="patch", comb=(1, 0, 0), lean_deg=30, bend_deg=0,
        comb_noise_deg=0, length_variation=0, length=0.1, **PLAIN_FUR,
    )  # fmt: skip
    whole = np.subtract(strands_of(curves)[:, -1], strands_of(curves)[:, 0]).mean(axis=0)
    np.testing.assert_allclose(whole / 0.1, [0.5, 0.0, np.sqrt(0.75)], atol=0.02)


def test_bend_turns_the_tip():
    curves = fur(
        n_strands=2000, n_points=50, surface="patch", comb=(1, 0, 0), lean_deg=10, bend_deg=60,
        comb_noise_deg=0, **PLAIN_FUR,
    )  # fmt: skip
    step = np.diff(strands_of(curves), axis=1)[:, [0, -1]]
    angle = np.degrees(np.arctan2(np.hypot(step[..., 0], step[..., 1]), step[..., 2]))
    turn = angle[:, 1] - angle[:, 0]
    # A strand that the random lean tips backwards unfolds first, so its turn comes out smaller.
    assert np.median(turn) == pytest.approx(60.0 * 48 / 49, abs=1.0)


def test_upright_where_the_comb_is_normal_to_the_surface():
    curves = fur(n_strands=20_000, comb=(0, 0, 1), comb_noise_deg=0, **PLAIN_FUR)
    points = strands_of(curves)
    pole = np.abs(points[:, 0, 2]) > 0.998
    whole = points[pole, -1] - points[pole, 0]
    upright = np.abs(whole[:, 2]) / np.linalg.norm(whole, axis=1)
    assert pole.sum() > 10
    assert upright.mean() > 0.95


def test_length_map_and_variation():
    lengths = arc_lengths(fur(n_strands=5000, **PLAIN_FUR, length=0.3, length_variation=0.0))
    np.testing.assert_allclose(lengths, 0.3, rtol=1e-3)
    mapped = {**PLAIN_FUR, "length_noise": 0.5}
    lengths = arc_lengths(fur(n_strands=5000, **mapped, length=0.3, length_variation=0.0))
    assert 0.15 * 0.999 <= lengths.min() < 0.2
    assert 0.25 < lengths.max() <= 0.3 * 1.001


def test_density_map_gathers_strands():
    def uneven(depth):
        curves = fur(
            n_strands=20_000, surface="patch", density_noise=depth, density_noise_scale=1.0
        )
        roots = strands_of(curves)[:, 0, :2]
        counts = np.histogram2d(*roots.T, bins=20)[0]
        return counts.std() / counts.mean()

    assert uneven(0.0) < 0.1  # 50 in a cell; independent ones would give 0.14
    assert uneven(0.9) > 0.3


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_undercoat(fraction):
    curves = fur(
        n_strands=10_000, undercoat=fraction, undercoat_length=0.4, undercoat_radius=0.5,
        radius=0.002, radius_variation=0.0, length_variation=0.0, length_noise=0.0, frizz=0.0,
        n_clumps=0,
    )  # fmt: skip
    root_radii = curves.radii.reshape(10_000, -1)[:, 0]
    under = np.isclose(root_radii, 0.001)
    assert (under | np.isclose(root_radii, 0.002)).all()
    # Five standard deviations of a binomial count.
    assert abs(under.mean() - fraction) <= 5 * np.sqrt(fraction * (1 - fraction) / 10_000)
    np.testing.assert_allclose(arc_lengths(curves), np.where(under, 0.08, 0.2), rtol=1e-3)


@pytest.mark.parametrize(("axis", "along", "across"), [("x", 0, 1), ("y", 1, 2), ("z", 2, 0)])
def test_fibre_row(axis, along, across):
    curves = fibre(
        count=3, length=4.0, radius=0.25, spacing=2.0, axis=axis, centre=(10, 20, 30), n_points=5
    )
    points = strands_of(curves) - (10, 20, 30)
    for i, row in enumerate((-2.0, 0.0, 2.0)):
        np.testing.assert_array_equal(points[i, :, along], [-2, -1, 0, 1, 2])
        np.testing.assert_array_equal(points[i, :, across], row)
        np.testing.assert_array_equal(points[i, :, 3 - along - across], 0)
    assert (curves.radii == 0.25).all()


def test_bodies_fit_inside():
    scalp = {"scalp_centre": (1, 2, 3), "scalp_radii": (2.0, 4.0, 6.0)}
    found = body_of("hair", scalp)
    assert found is not None
    np.testing.assert_allclose(found, [[1, 2, 3], [1.99, 3.98, 5.97]])
    assert body_of("fur", {"sphere_radius": 2.0}) == ((0.0, 0.0, 0.0), (1.99, 1.99, 1.99))
    assert body_of("fur", {"surface": "patch"}) is None
    assert body_of("fibre", {}) is None
