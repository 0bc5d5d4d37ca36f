"""Pictures with light samples against pictures without, block by block, and in a furnace."""

import numpy as np
import pytest
from direction_statistics import sidak
from kernel_mutants import substitute
from scene_documents import fur_patch
from scipy import stats
from test_own_sampler import EXAMPLE

import furcl
from furcl.fibre import samplers
from furcl.scene.read import with_overrides

SAMPLERS = ("uniform-h", "attenuation-cdf", "full-cdf", "mine")
BLOCK = 8
N_BLOCKS = (24 // BLOCK) * (16 // BLOCK)


@pytest.fixture(autouse=True)
def own_sampler():
    samplers.register("mine", EXAMPLE, needs_tables=True)
    yield
    samplers.unregister("mine")


def z_of_blocks(a, b) -> np.ndarray:
    """z of the difference of two pictures' means over blocks of 8 x 8 pixels, second channel."""

    def blocks(values):
        rows = values[..., 1].astype(np.float64).reshape(-1, BLOCK, values.shape[1] // BLOCK, BLOCK)
        return rows.mean(axis=(1, 3)).ravel()

    variance = (blocks(a.variance) + blocks(b.variance)) / BLOCK**2
    return (blocks(a.rgb) - blocks(b.rgb)) / np.sqrt(variance)


def patch(spp=1024, **render):
    sun = "environment.sun_radius_deg=20"  # soft: rays alone find it often enough
    return with_overrides(fur_patch(spp=spp, **render), ["fibre.preset=raccoon", sun])


@pytest.fixture(scope="module")
def without(device):
    return furcl.render(patch(light_sampling="bcsdf", spp=8192, seed=11), device=device)


@pytest.mark.statistical
@pytest.mark.parametrize("sampling", SAMPLERS)
def test_light_samples_change_no_mean(device, seed, without, sampling):
    """Block by block; 3 % more light must be seen."""
    scene = patch(light_sampling="mis", sampling=sampling, seed=seed)
    found = furcl.render(scene, device=device)
    limit = stats.norm.isf(0.5 * sidak(N_BLOCKS * len(SAMPLERS)))
    assert np.abs(z_of_blocks(found, without)).max() < limit
    brighter = furcl.Image(found.rgb * np.float32(1.03), found.variance)
    assert np.abs(z_of_blocks(brighter, without)).max() > limit


def furnace_z(device, seed, sampling) -> float:
    """Of the mean of a clear white patch in white light, from 1."""
    scene = with_overrides(
        fur_patch(
            {"sigma_ca": 0.0}, spp=256, roulette_depth=1000, max_depth=200, residual=True,
            light_sampling="mis", sampling=sampling, seed=seed,
        ),
        ["environment={kind='constant', radiance=1.0}"],
    )  # fmt: skip
    image = furcl.render(scene, device=device)
    assert image.variance is not None
    error = np.sqrt(image.variance[..., 0].astype(np.float64).sum()) / image.variance[..., 0].size
    return float((image.rgb[..., 0].mean(dtype=np.float64) - 1.0) / error)


@pytest.mark.statistical
@pytest.mark.parametrize("sampling", SAMPLERS)
def test_white_fibres_vanish_in_a_furnace(device, seed, sampling):
    """Within 4 standard errors."""
    assert abs(furnace_z(device, seed, sampling)) < 4.0


MUTANTS = {
    "weights of rays from another density": (
        r"bounce\.pdf = direction_density\(fibre, in, d\)\.sum;",
        "bounce.pdf = 2.0f * direction_density(fibre, in, d).sum;",
    ),
    "light samples weighed against half the density": (
        r"(towards\.value .*)rival_density\(&chosen, towards\.pdf\)",
        r"\1rival_density(&chosen, 0.5f * towards.pdf)",
    ),
}


@pytest.mark.statistical
@pytest.mark.parametrize("mutant", MUTANTS)
def test_weights_that_do_not_sum_to_1_are_seen(device, seed, monkeypatch, mutant):
    substitute(monkeypatch, *MUTANTS[mutant], within="stages/shade.cl")
    assert abs(furnace_z(device, seed, "full-cdf")) > 8.0
