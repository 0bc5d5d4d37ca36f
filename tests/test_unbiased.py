"""The comparison of variants by blocks: its statistics on simulated pictures, and small renders
with a mutant of the film and one of a kernel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from biased_sampler import biased_sampler
from scene_documents import even_patch, fur_patch

if not (Path(__file__).parents[1] / "bench").is_dir():
    pytest.skip("bench/ is not in a source distribution", allow_module_level=True)

import unbiased

from furcl.bench.convergence_variants import Variant
from furcl.scene.read import with_overrides

# A sun of 5 degrees is too small for BCSDF samples: means of 16 runs of 256 samples were up to 7 of
# their own standard errors too low, each time in other blocks.
BROAD_SUN = with_overrides(fur_patch(), ["environment.sun_radius_deg=20"])
N_TESTS = unbiased.N_BLOCKS**2 + 1
BASE = Variant.parse("reference: sampling=uniform-h light_sampling=bcsdf")
VARIANTS = [
    Variant.parse("baseline: sampling=uniform-h light_sampling=bcsdf"),
    Variant.parse("light samples: sampling=uniform-h light_sampling=mis"),
    Variant.parse("proposed: sampling=attenuation-cdf light_sampling=bcsdf"),
    Variant.parse("roulette: sampling=full-cdf light_sampling=mis roulette_depth=0"),
]


def test_blocks_are_means_of_64_parts_and_of_the_whole():
    picture = np.arange(16 * 24 * 3, dtype=np.float64).reshape(16, 24, 3)
    found = unbiased.blocks(picture)
    assert found.shape == (N_TESTS,)
    assert found[0] == picture[:2, :3].mean()
    assert found[9] == picture[2:4, 3:6].mean()
    assert found[63] == picture[14:, 21:].mean()
    assert found[64] == picture.mean()


def test_z_of_two_samples_by_hand():
    """Welch: t = 2 / sqrt(1/3 + 4/3) = 1.5492 with 2.94118 degrees of freedom, p = 0.2211."""
    variant, reference = np.array([[4.0], [5.0], [6.0]]), np.array([[1.0], [3.0], [5.0]])
    z = unbiased.z_scores(variant, reference)
    assert z[0] == pytest.approx(1.22419, abs=1e-5)
    assert unbiased.z_scores(reference, variant)[0] == pytest.approx(-z[0])
    same = np.ones((3, 1))
    assert unbiased.z_scores(same, same)[0] == 0.0
    assert unbiased.z_scores(same, 1.5 * same)[0] < -30.0


@pytest.mark.statistical
def test_as_many_families_fail_as_the_bound_says(rng):
    """2000 families of 65 tests at 5 % in all; binomial bounds at alpha 1e-4. A bias of two errors
    in one block, the mutant, makes more of them fail."""
    n = 2000
    limit = unbiased.bound(N_TESTS, 0.05)
    shape = (n, 16, N_TESTS)
    variants, references = rng.normal(0.0, 2.0, shape), rng.normal(0.0, 1.0, shape)
    pairs = list(zip(variants, references, strict=True))
    failed = sum(np.abs(unbiased.z_scores(a, b)).max() > limit for a, b in pairs)
    assert 0.7 * 0.05 * n < failed < 0.05 * n + 3.9 * np.sqrt(n * 0.05 * 0.95)
    biased = np.where(np.arange(N_TESTS) == 7, 2.0 * np.sqrt(5.0 / 16.0), 0.0)
    failed = sum(np.abs(unbiased.z_scores(a + biased, b)).max() > limit for a, b in pairs)
    assert failed > 0.1 * n


def test_the_bound_grows_with_the_family():
    assert unbiased.bound(1, 0.05) == pytest.approx(1.95996, abs=1e-4)
    assert unbiased.bound(2, 0.05) == pytest.approx(2.24140, abs=1e-4)


def results(device, scene, variants, light="even", **changes):
    numbers = {"runs": 16, "spp": 64, "reference_spp": 128, **changes}
    return unbiased.compare(scene, light, variants, BASE, device, **numbers)


@pytest.mark.slow
@pytest.mark.statistical
@pytest.mark.parametrize("scene", [even_patch(), BROAD_SUN], ids=["even", "sky"])
def test_variants_show_the_picture_of_the_baseline(device, scene):
    """And times 1.02, the mutant of the film, they do not."""
    limit, failed = unbiased.verdict(results(device, scene, VARIANTS))
    assert limit == pytest.approx(unbiased.bound(4 * N_TESTS))
    assert not failed
    scaled = results(device, scene, VARIANTS[1:2], scale=1.02)
    assert unbiased.verdict(scaled)[1] == scaled


@pytest.mark.slow
@pytest.mark.statistical
def test_a_weight_of_2_percent_too_much_is_seen(device, tmp_path):
    """The mutant of a kernel: a sampler whose density is 2 % too small."""
    with biased_sampler(tmp_path, 0.98) as wrong:
        found = results(device, even_patch(), [Variant.of_sampler(wrong)])
    assert unbiased.verdict(found)[1] == found
    assert found[0].relative > 4.0 * found[0].error


def test_where_chance_finds_the_light_only_its_samples_are_compared(device):
    found = results(device, fur_patch(), VARIANTS[:2], light="sun", runs=2, spp=1, reference_spp=1)
    assert [result.variant for result in found] == ["light samples"]
    assert "light_sampling=mis" in " ".join(unbiased.reference_of("sun").settings)
    assert "light_sampling=bcsdf" in " ".join(unbiased.reference_of("even").settings)
