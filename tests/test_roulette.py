"""Russian roulette of paths and of light samples: its mean, its weights, its settings."""

import numpy as np
import pytest
from direction_statistics import sidak
from kernel_harness import call
from kernel_mutants import substitute
from model_checks import furnace_z
from scene_documents import fur_patch
from scipy import stats

import furcl
from furcl.device.features import Features
from furcl.scene.read import with_overrides

SPP = 512
BLOCK = 4  # pixels
VARIANTS = {
    "paths": {"roulette": "throughput", "roulette_threshold": 0.5},
    "both": {"roulette": "throughput", "roulette_threshold": 0.3, "shadow_threshold": 0.5},
    "adjoint": {"roulette": "adjoint"},
}


def _scene(seed, **render):
    """Dense white fur, whose paths are long, under a sky that is sampled."""
    scene = fur_patch({"preset": "white"}, light_sampling="mis", spp=SPP, **render)
    return with_overrides(scene, ["curves.n_strands=2000"], seed=seed)


def _largest_z(image, reference):
    """Over the blocks of two independent pictures: the largest difference in standard errors, and
    how many blocks there are."""

    def blocks(values):
        height, width = values.shape
        shape = (height // BLOCK, BLOCK, width // BLOCK, BLOCK)
        return values.astype(np.float64).reshape(shape).sum(axis=(1, 3)).ravel()

    green = [blocks(each.rgb[..., 1]) for each in (image, reference)]
    error = np.sqrt(sum(blocks(each.variance[..., 1]) for each in (image, reference)))
    z = np.abs(green[0] - green[1]) / np.maximum(error, 1e-12)
    return z.max(), len(z)


@pytest.fixture(scope="module")
def reference(device):
    """Paths that end where they leave, or at the depth limit: no roulette at all."""
    return furcl.render(_scene(2, roulette_depth=1000), device=device)


@pytest.mark.statistical
@pytest.mark.parametrize("name", VARIANTS)
def test_the_mean_of_every_block_is_that_without_roulette(device, seed, reference, name):
    """One per cent for all blocks of all variants together."""
    image = furcl.render(_scene(seed, **VARIANTS[name]), device=device)
    assert image.stats["rays"] < 0.9 * reference.stats["rays"]
    z, n = _largest_z(image, reference)
    assert z < stats.norm.isf(sidak(n * len(VARIANTS)) / 2)


MUTANTS = {
    "paths": r"throughput /= keep_next;",
    "both": r"light /= keep_shadow;",
    "adjoint": r"throughput /= keep_next;",
}


@pytest.mark.statistical
@pytest.mark.parametrize("name", MUTANTS)
def test_roulette_without_its_weight_is_seen(device, seed, reference, monkeypatch, name):
    """Mutants of the test above."""
    substitute(monkeypatch, MUTANTS[name], "", within="stages/shade.cl")
    image = furcl.render(_scene(seed, **VARIANTS[name]), device=device)
    z, n = _largest_z(image, reference)
    assert z > stats.norm.isf(sidak(n * len(VARIANTS)) / 2)


@pytest.mark.statistical
def test_white_fur_vanishes_in_a_furnace(device, seed):
    """By learned roulette, within 4 standard errors; mutant: a cortex that absorbs."""
    scene = with_overrides(
        fur_patch(spp=32, residual=True, **VARIANTS["adjoint"]),
        ["environment={kind='constant', radiance=1.0}", "fibre.sigma_ma=0.0"],
        seed=seed,
    )
    assert abs(furnace_z(with_overrides(scene, ["fibre.sigma_ca=0.0"]), device)) < 4.0
    assert furnace_z(with_overrides(scene, ["fibre.sigma_ca=0.03"]), device) < -4.0


def test_roulette_raises_no_throughput_above_the_threshold(device, rng):
    """Worth over the chance to be kept: the threshold or, above it, the worth; within rounding."""
    worth = np.exp(rng.uniform(-40, 5, 10_000)).astype(np.float32)
    for threshold in (0.02, 0.3, 1.0, 40.0):
        chance = call(
            device, "core/continue_path.clh", f"survival(x, {threshold}f)", worth,
            features=Features(roulette=True),
        )  # fmt: skip
        assert chance.min() > 0.0
        assert chance.max() <= 1.0
        np.testing.assert_allclose(worth / chance, np.maximum(worth, threshold), rtol=1e-6)


def test_by_depth_is_by_throughput_over_one(device):
    """To the bit: the defaults that the kinds of roulette stand for."""
    same = [
        {"roulette": "depth"},
        {"roulette": "throughput", "roulette_depth": 8, "roulette_threshold": 1.0},
    ]
    images = [furcl.render(fur_patch(light_sampling="mis", **s), device=device) for s in same]
    assert images[0].rgb.tobytes() == images[1].rgb.tobytes()


def test_a_scene_without_light_samples_has_no_roulette_of_them(device):
    for light_sampling in ("bcsdf", "mis"):
        scene = fur_patch(light_sampling=light_sampling, shadow_threshold=0.1)
        compiled = furcl.render(scene, device=device).stats["features"]["compiled"]
        assert compiled["shadow_roulette"] == (light_sampling == "mis")
