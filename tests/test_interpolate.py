"""Children of guide strands."""

from itertools import pairwise

import numpy as np
import pytest
from mesh_files import obj_text
from scene_documents import minimal
from scipy.stats import chisquare

from furcl.errors import GroomError, SceneError
from furcl.groom.curves import Curves
from furcl.groom.formats import save_curves
from furcl.groom.grow.interpolate import NEIGHBOURS, children
from furcl.groom.grow.strands import BLOCK_STRANDS
from furcl.scene.read import decode_scene


@pytest.fixture
def guides(rng):
    """144 guides on a square, of 4 to 9 points, that lean with their place; `kind` is their row."""
    x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
    roots = np.stack([x.ravel(), y.ravel(), np.zeros(144)], 1)
    counts = rng.integers(4, 10, 144)
    parts = []
    for root, count in zip(roots, counts, strict=True):
        s = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0.05, 0.95, count - 2)]))[:, None]
        parts.append(root + s * np.array([0.3 + 0.05 * root[0], 0.1, 2.0]))
    return Curves.from_arrays(
        np.concatenate(parts),
        0.01 + 0.001 * np.repeat(roots[:, 0], counts),
        np.concatenate([[0], np.cumsum(counts)]),
        attributes={"kind": roots[:, 1], "of_points": np.zeros(counts.sum())},
    )


def strands_of(curves, k):
    return curves.points.reshape(-1, k, 3).astype(np.float64)


def test_children_of_a_linear_field_are_in_it(guides):
    """Guides whose way is linear in their root have children whose way is, too."""
    found = children(guides, n_strands=3 * BLOCK_STRANDS + 5, n_points=6, length_variation=0.0)
    assert found.n_strands == 3 * BLOCK_STRANDS + 5
    strands = strands_of(found, 6)
    root = strands[:, :1]
    s = np.linspace(0.0, 1.0, 6)[:, None]
    way = np.array([0.3, 0.1, 2.0]) + 0.05 * root * [1.0, 0.0, 0.0]
    np.testing.assert_allclose(strands, root + s * way, atol=2e-5)
    np.testing.assert_allclose(
        found.radii.reshape(-1, 6), 0.01 + 0.001 * np.repeat(root[:, :, 0], 6, 1), rtol=1e-4
    )


def test_each_guide_has_as_many_children(guides):
    found = children(guides, n_strands=1500)
    strands = strands_of(found, int(np.diff(guides.offsets).max()))
    own = found.attributes["kind"]
    counts = np.bincount(own.astype(int))
    assert counts.sum() == 1500
    assert counts.max() - counts.min() <= 12  # of 12 guides each
    assert "of_points" in found.ignored
    # A child is nearer to its own row than halfway to the next but one.
    assert np.abs(strands[:, 0, 1] - own).max() <= 4.0 / 3.0 + 1e-5


def test_children_fill_the_square_evenly(guides):
    root = strands_of(children(guides, n_strands=40_000, n_points=2), 2)[:, 0]
    inner = root[((root[:, :2] > 3.5) & (root[:, :2] < 7.5)).all(axis=1)]
    counts, _, _ = np.histogram2d(*inner[:, :2].T, bins=4, range=((3.5, 7.5), (3.5, 7.5)))
    assert counts.std() < 0.05 * counts.mean()


def test_clumping_draws_tips_together(guides):
    def spread(clumping):
        found = children(
            guides, n_strands=4000, n_points=5, clumping=clumping, length_variation=0.0
        )
        strands = strands_of(found, 5)
        kind = found.attributes["kind"].astype(int)
        return [np.mean([strands[kind == r, j, 1].std() for r in range(12)]) for j in (0, -1)]

    (root, tip), (root_drawn, tip_drawn) = spread(0.0), spread(1.0)
    assert root_drawn == pytest.approx(root)
    assert tip_drawn < 0.05 * tip


def test_a_parting_stays_one(guides):
    """Guides left and right of it lean away from each other; no child stands up between them."""
    side = np.where(strands_roots(guides)[:, 0] < 5.5, -1.0, 1.0)
    points = guides.points.astype(np.float64)
    root = np.repeat(points[guides.offsets[:-1]], np.diff(guides.offsets), axis=0)
    lean = np.repeat(side, np.diff(guides.offsets))
    points[:, 0] = root[:, 0] + lean * (points[:, 2] - root[:, 2])
    parted = Curves.from_arrays(points, guides.radii, guides.offsets)
    for spread_deg, few in ((60.0, True), (180.0, False)):
        strands = strands_of(children(parted, n_strands=4000, n_points=3, spread_deg=spread_deg), 3)
        way = strands[:, -1] - strands[:, 0]
        upright = np.abs(way[:, 0]) < 0.5 * way[:, 2]
        assert (upright.mean() == 0.0) == few


def strands_roots(guides):
    return guides.points[guides.offsets[:-1]]


def test_lengths_radii_and_seeds(guides):
    plain = children(guides, n_strands=3000, n_points=6, length_variation=0.0)
    cut = children(guides, n_strands=3000, n_points=6, length_variation=0.5, radius=0.2)
    lengths = [
        np.linalg.norm(np.diff(strands_of(c, 6), axis=1), axis=2).sum(axis=1) for c in (plain, cut)
    ]
    ratio = lengths[1] / lengths[0]
    assert 0.5 <= ratio.min() < 0.51
    assert 0.99 < ratio.max() <= 1.0 + 1e-5
    np.testing.assert_allclose(cut.radii.reshape(-1, 6)[:, 0], 0.2, rtol=1e-5)
    again = children(guides, n_strands=3000, n_points=6, length_variation=0.0)
    np.testing.assert_array_equal(again.points, plain.points)
    other = children(guides, n_strands=3000, n_points=6, length_variation=0.0, seed=2)
    assert not np.array_equal(other.points, plain.points)
    wild = children(guides, n_strands=3000, n_points=6, length_variation=0.0, frizz=0.2)
    np.testing.assert_array_equal(wild.points[::6], plain.points[::6])
    assert np.abs(wild.points - plain.points).max() > 0.1


@pytest.mark.parametrize("m", [1, 2, 3, NEIGHBOURS])
def test_few_guides(m):
    points = np.zeros((m, 3, 3))
    points[:, :, 2] = [0.0, 1.0, 2.0]
    points[:, :, 0] = np.arange(m)[:, None]
    found = children(Curves.from_arrays(points, 0.1), n_strands=50)
    assert found.n_strands == 50
    assert found.points[:, 0].min() >= 0.0
    assert found.points[:, 0].max() <= m - 1


def test_a_scene_grows_children(tmp_path, guides):
    save_curves(guides, tmp_path / "guides.npz")
    table = {"generator": "interpolate", "file": str(tmp_path / "guides.npz"), "n_strands": 500}
    curves = decode_scene(minimal(curves={**table, "radius_scale": 2.0})).build_curves()
    assert curves.n_strands == 500
    assert curves.radii.min() > 0.019


@pytest.fixture
def hill(tmp_path):
    """A mesh over the square of the guides and far beyond it, z = x / 10, of uneven triangles."""
    x = np.concatenate([np.linspace(-20.0, 4.0, 5), np.linspace(4.5, 31.0, 40)])
    corners = []
    for left, right in pairwise(x):
        a, b, c, d = ([u, v, 0.1 * u] for u in (left, right) for v in (-20.0, 31.0))
        corners += [[a, c, d], [a, d, b]]
    path = tmp_path / "hill.obj"
    path.write_text(obj_text(np.array(corners)))
    return str(path)


def on_mesh(tmp_path, guides, mesh_file, **changes):
    """Children on a mesh, as a scene grows them."""
    save_curves(guides, tmp_path / "guides.npz")
    table = {
        "generator": "interpolate", "file": str(tmp_path / "guides.npz"), "mesh_file": mesh_file,
        "n_strands": 20_000, "n_points": 4, "length_variation": 0.0,
    }  # fmt: skip
    return decode_scene(minimal(curves={**table, **changes})).build_curves()


def test_roots_are_on_the_mesh_where_guides_are(tmp_path, guides, hill):
    """Evenly, whatever its triangles are, within reach of a guide and not beyond."""
    root = strands_of(on_mesh(tmp_path, guides, hill, root_reach=1.8), 4)[:, 0]
    np.testing.assert_allclose(root[:, 2], 0.1 * root[:, 0], atol=1e-5)
    distance = np.linalg.norm(
        root[:, None] - strands_roots(guides)[None].astype(np.float64), axis=2
    ).min(axis=1)
    assert distance.max() <= 1.8 + 1e-5
    assert root[:, :2].min() < -1.0
    counts, _, _ = np.histogram2d(*root[:, :2].T, bins=5, range=((0, 10), (0, 10)))
    assert chisquare(counts.ravel()).pvalue > 0.01
    skewed = counts * np.linspace(0.85, 1.15, 5)
    assert chisquare(skewed.ravel() * counts.sum() / skewed.sum()).pvalue < 1e-6


def test_children_on_a_mesh_go_as_the_guides_around_them(tmp_path, guides, hill):
    """Within the square their ways are between those of the guides next to them: the field is
    linear, and weights fall with distance. At a guide's root a child is that guide."""
    found = strands_of(on_mesh(tmp_path, guides, hill), 4)
    root, way = found[:, 0], found[:, -1] - found[:, 0]
    inside = ((root[:, :2] > 1.0) & (root[:, :2] < 10.0)).all(axis=1)
    expected = np.array([0.3, 0.1, 2.0]) + 0.05 * root[:, :1] * [1.0, 0.0, 0.0]
    assert np.abs(way - expected)[inside].max() < 0.05
    at = strands_roots(guides)
    same = children(guides, n_strands=144, n_points=4, length_variation=0.0, roots=at)
    whole = children(guides, n_strands=144, n_points=4, length_variation=0.0, spread_deg=0.0)
    ways = [strands_of(c, 4)[:, -1] - strands_of(c, 4)[:, 0] for c in (same, whole)]
    found, expected = (np.sort(way, axis=0) for way in ways)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_children_on_a_mesh_are_the_same_again(tmp_path, guides, hill):
    again = [on_mesh(tmp_path, guides, hill, seed=seed).points for seed in (1, 1, 2)]
    np.testing.assert_array_equal(again[0], again[1])
    assert not np.array_equal(again[0], again[2])


def test_guides_must_be_at_the_mesh(tmp_path, guides, hill):
    with pytest.raises(GroomError, match=r"hill\.obj: next to nothing of it is within 0\.0001 of"):
        on_mesh(tmp_path, guides, hill, root_reach=1e-4)
    one = Curves.from_arrays(np.array([[[0, 0, 0], [0, 0, 1.0]]]), 0.1)
    with pytest.raises(GroomError, match=r"1 guides say not how far .* give curves.root_reach"):
        on_mesh(tmp_path, one, hill)
    with pytest.raises(SceneError, match=r"root_reach = 1.*: roots are on no mesh; give mesh_file"):
        on_mesh(tmp_path, guides, None, root_reach=1.0)


def test_children_of_a_guide_are_a_clump(guides):
    found = children(guides, n_strands=3000)
    own = np.unique(found.attributes["clump"])
    assert len(own) == 144
    assert own.min() >= 0.0
    assert own.max() < 1.0
    assert np.diff(own).max() < 3.0 / 144


@pytest.mark.parametrize("generator", ["hair", "fur"])
def test_grown_strands_of_a_clump_share_a_number(generator):
    """And are nearer to each other at their tips than to the rest."""
    table = {"generator": generator, "n_strands": 2000, "n_clumps": 20, "clumping": 1.0}
    if generator == "fur":
        table |= {"surface": "patch", "comb_noise_deg": 0.0}
    curves = decode_scene(minimal(curves=table)).build_curves()
    clump = curves.attributes["clump"]
    assert 10 < len(np.unique(clump)) <= 20
    tips = curves.points[curves.offsets[1:] - 1].astype(np.float64)
    within = np.mean([tips[clump == c].std(axis=0).sum() for c in np.unique(clump)])
    assert within < 0.6 * tips.std(axis=0).sum()
    none = decode_scene(minimal(curves={**table, "n_clumps": 0})).build_curves()
    assert "clump" not in none.attributes


def test_a_mesh_is_turned_as_its_guides(tmp_path, guides, hill):
    """With y up both are turned: the same children, turned."""
    plain = on_mesh(tmp_path, guides, hill, n_strands=500).points
    up = on_mesh(tmp_path, guides, hill, n_strands=500, up_axis="y").points
    np.testing.assert_allclose(up, plain[:, [0, 2, 1]] * [1.0, -1.0, 1.0], atol=1e-5)
