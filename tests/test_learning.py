"""What is learned while rendering changes no mean, and no bit by how the work is cut."""

import numpy as np
from scene_documents import fur_patch, single_fibre

import furcl
from furcl.rendering.learning import (
    MAX_THRESHOLD,
    MIN_THRESHOLD,
    MIN_VISIBLE,
    N_CELLS,
    N_COUNTS,
    N_DEPTHS,
    N_EXPONENTS,
    thresholds,
)
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides

ADJOINT = {"roulette": "adjoint", "light_sampling": "mis"}


def _bits(image):
    return image.rgb.tobytes(), image.variance.tobytes()


def _scene(**render):
    return with_overrides(
        fur_patch({"preset": "white"}, **ADJOINT | render), ["curves.n_strands=1000"]
    )


def test_wave_size_changes_no_bit(device):
    """Waves end where something is learned, whatever their size; so do rays and lobes agree."""
    images = [
        furcl.render(_scene(spp=24), device=device, wave_size=n) for n in (1 << 18, 1000, 100)
    ]
    assert _bits(images[0]) == _bits(images[1]) == _bits(images[2])
    assert images[0].stats["rays"] == images[1].stats["rays"] == images[2].stats["rays"]
    unlearned = furcl.render(_scene(spp=24, roulette="throughput"), device=device)
    assert _bits(unlearned) != _bits(images[0])


def test_a_render_cut_in_pieces_is_the_same(device):
    renderer = Renderer(_scene(), device, wave_size=700)
    for spp in (1, 4, 1, 18):
        assert renderer.advance(spp)
    assert _bits(renderer.image()) == _bits(furcl.render(_scene(spp=24), device=device))


def test_a_render_that_is_stopped_goes_on_the_same(device):
    """After the first sample, before anything is learned, and in the middle of learning."""
    renderer = Renderer(_scene(), device, wave_size=24 * 16)
    for already in (1, 2, 3):
        assert not renderer.advance(20, progress=lambda done, of: True)
        assert renderer.samples_done == already
    renderer.advance(21)
    assert _bits(renderer.image()) == _bits(furcl.render(_scene(spp=24), device=device))


def test_a_restart_forgets(device):
    renderer = Renderer(_scene(), device)
    renderer.advance(24)
    renderer.restart(5)
    renderer.advance(24)
    assert _bits(renderer.image()) == _bits(furcl.render(_scene(spp=24), seed=5, device=device))


def _counts(renderer):
    counts = renderer.memory.read(
        renderer.wavefront.learning.counts, (N_CELLS, N_COUNTS), np.uint32
    )
    return counts.astype(np.int64)


def test_what_came_back_is_counted(device):
    """A straight fibre in even light: all rays that leave it bring 0.5 and meet nothing."""
    scene = single_fibre(30.0, {"preset": "human-black"}, roulette="adjoint", spp=4)
    scene = with_overrides(scene, ["environment.radiance=0.5"])
    renderer = Renderer(scene, device)
    renderer.advance(3)
    counts = _counts(renderer)
    rays = renderer.rays - renderer.paths_done
    assert 0.1 * renderer.paths_done < rays < renderer.paths_done
    expected = np.zeros(N_COUNTS, int)
    expected[[126, N_EXPONENTS, N_EXPONENTS + 1]] = rays  # 0.5 = 2^(126 - 127)
    # Radiance that came back is a difference of sums: rounding makes some of it less than a half.
    counts[:, 126] += counts[:, 125]
    counts[:, 125] = 0
    np.testing.assert_array_equal(counts.sum(axis=0), expected)
    # Across the fibre, whose box is as thin as it, nothing lies before a ray.
    assert counts[:, :N_EXPONENTS].sum(axis=1)[::N_DEPTHS].sum() > 0.5 * rays


def test_rays_that_follow_are_counted(device):
    """As often as all rays of all paths: those of the camera precede, and no path is as long as the
    records."""
    scene = _scene(spp=4, max_depth=4, roulette_depth=1000)
    renderer = Renderer(scene, device)
    renderer.advance(1)
    counts = _counts(renderer)
    n_rays = counts[:, :N_EXPONENTS].sum()
    # The last hits, at the depth limit, scatter no more and are not recorded.
    assert 0 < n_rays <= renderer.rays - renderer.shadow_rays - renderer.paths_done
    followed, missed = counts[:, N_EXPONENTS].sum(), counts[:, N_EXPONENTS + 1].sum()
    assert n_rays <= followed
    assert missed < n_rays


def test_thresholds_are_those_of_equal_worth():
    """By hand: cells with many rays that all brought the same."""
    counts = np.zeros((N_CELLS, N_COUNTS))
    counts[0, [125, N_EXPONENTS, N_EXPONENTS + 1]] = 1e9, 2e9, 0.25e9
    counts[1, [129, N_EXPONENTS, N_EXPONENTS + 1]] = 1e9, 8e9, 0.0
    paths, shadows = thresholds(counts, 0.1)
    # An octave from 0.25 on: mean square 0.25^2 1.5 / ln 2.
    octave = 1.5 / np.log(2.0)
    np.testing.assert_allclose(paths[0], 0.1 * np.sqrt(2.0 / (0.0625 * octave)), rtol=1e-6)
    np.testing.assert_allclose(paths[1], 0.1 * np.sqrt(8.0 / (16.0 * octave)), rtol=1e-6)
    np.testing.assert_allclose(shadows[:2], [0.2, 0.1 * np.sqrt(1.0 / MIN_VISIBLE)], rtol=1e-6)
    # Other directions are as these where as much lies before them; else as the mean of both.
    mean = 0.1 * np.sqrt(5.0 / (0.5 * (0.0625 + 16.0) * octave))
    others = paths.reshape(-1, N_DEPTHS)[1:]
    np.testing.assert_allclose(others[:, :2], [paths[:2]] * len(others), rtol=1e-5)
    np.testing.assert_allclose(others[:, 2:], mean, rtol=1e-6)


def test_thresholds_are_bounded():
    """Where nothing comes back, and where all is light."""
    for brought in (0, 126, 254):
        counts = np.zeros((N_CELLS, N_COUNTS))
        counts[:, [brought, N_EXPONENTS]] = 1000.0
        paths, shadows = thresholds(counts, 0.1)
        assert MIN_THRESHOLD <= paths.min() <= paths.max() <= MAX_THRESHOLD
        assert 0.0 < shadows.min() <= shadows.max() <= 0.1 / np.sqrt(MIN_VISIBLE)
    nothing = thresholds(np.zeros((N_CELLS, N_COUNTS)), 0.1)
    assert np.isfinite(nothing).all()


def test_learning_pays(device):
    """Variance times rays in white fur, less than by depth; measured 0.82 of it."""
    costs = []
    for roulette in ("depth", "adjoint"):
        image = furcl.render(_scene(roulette=roulette, spp=128), device=device)
        assert image.variance is not None
        costs.append(image.variance.mean() * image.stats["rays"])
    assert costs[1] < 0.9 * costs[0]
