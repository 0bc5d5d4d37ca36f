"""Pictures by Sobol numbers: the same light, less noise, the same bits however they are made."""

from __future__ import annotations

import re

import numpy as np
import pytest
from direction_statistics import sidak
from kernel_mutants import substitute
from scene_documents import even_patch, fur_patch
from scipy import stats

import furcl
from furcl.bench import convergence
from furcl.bench.convergence_plan import Plan
from furcl.image.exr import read_exr
from furcl.image.image import Image
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides

SEEDS = range(12)
SPP = 32


def _renders(device, sequence):
    """(seeds, H, W, 3) pictures without single bright samples, and the mean of the variances that
    they keep."""
    changes = [f"render.sequence={sequence}", "render.light_sampling=mis"]
    renderer = Renderer(with_overrides(even_patch(), changes), device)
    assert renderer.features.sequence == sequence
    pictures, own = [], []
    for seed in SEEDS:
        renderer.restart(seed)
        renderer.advance(SPP)
        image = renderer.image()
        assert image.variance is not None
        pictures.append(image.rgb.astype(np.float64))
        own.append(float(image.variance.astype(np.float64).mean()))
    return np.array(pictures), float(np.mean(own))


@pytest.fixture(scope="module")
def independent(device):
    return _renders(device, "independent")


def _least_p(a, b):
    """Least p-value of t-tests, over seeds, of the means of 16 blocks of two sets of pictures."""
    height, width = a.shape[1:3]

    def blocks(pictures):
        parts = pictures.reshape(len(pictures), 4, height // 4, 4, width // 4, 3)
        return parts.mean(axis=(2, 4, 5)).reshape(len(pictures), -1)

    seen = blocks(a).std(axis=0) > 0.0  # some blocks see nothing but the light
    assert seen.sum() > 8
    found = stats.ttest_ind(blocks(a)[:, seen], blocks(b)[:, seen], equal_var=False)
    return float(np.min(found.pvalue))  # pyright: ignore[reportAttributeAccessIssue]


LEVEL = sidak(16)


def test_light_is_the_same(device, independent):
    assert _least_p(_renders(device, "sobol")[0], independent[0]) > LEVEL


def test_numbers_of_half_the_range_are_seen(device, independent, monkeypatch):
    whole = "SOBOL_POINT(a, b, c, d, pixel, key, LANES_UINT)"
    half = whole + " a >>= 1; b >>= 1; c >>= 1;"
    substitute(monkeypatch, re.escape(whole), half, within="stages/shade.cl")
    assert _least_p(_renders(device, "sobol")[0], independent[0]) < LEVEL


def test_error_is_smaller_and_own_variance_an_upper_bound(device, independent):
    """Over seeds, whose pictures are independent. Measured: 0.46 of the
    error of independent numbers, and own variance 2.23 of it; of independent ones 1.004."""
    pictures, own = _renders(device, "sobol")
    error = pictures.var(axis=0, ddof=1).mean()
    before = independent[0].var(axis=0, ddof=1).mean()
    assert error < 0.6 * before
    assert own > 1.5 * error
    # The same of independent numbers does not hold: theirs is the error.
    assert independent[1] == pytest.approx(before, rel=0.1)


def test_wave_size_and_stops_change_no_bit(device):
    scene = fur_patch(sequence="sobol", light_sampling="mis", spp=6)
    whole = furcl.render(scene, device=device).rgb
    assert np.array_equal(furcl.render(scene, device=device, wave_size=100).rgb, whole)
    renderer = Renderer(scene, device)
    for spp in (1, 3, 2):
        renderer.advance(spp)
    assert np.array_equal(renderer.image().rgb, whole)
    other = furcl.render(fur_patch(sequence="independent", light_sampling="mis", spp=6))
    assert not np.array_equal(other.rgb, whole)


@pytest.mark.parametrize("sequence", ["independent", "sobol"])
def test_files_say_which_sequence(device, tmp_path, sequence):
    path = tmp_path / "a.exr"
    image = furcl.render(fur_patch(sequence=sequence, spp=1), device=device)
    image.save(path)
    assert image.stats["sequence"] == sequence
    assert ("sobol" in image.stats["features"]["left_out"]) == (sequence == "independent")
    assert read_exr(path)[1]["furcl:sequence"] == sequence


@pytest.mark.slow
@pytest.mark.parametrize("sequence", ["independent", "sobol"])
def test_benchmark_takes_errors_from_independent_renders(device, tmp_path, monkeypatch, sequence):
    """The reference's error is that between its parts where a part's own variance is too large:
    measured 0.4 of it. With independent numbers the two are the same."""
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path / "cache"))
    scene = with_overrides(even_patch(), [f"render.sequence={sequence}"])
    plan = Plan((scene,), sampling=("uniform-h",), spp=(8, 16), runs=2)
    found = convergence.run(plan, tmp_path / "out", device=device)["scenes"][0]
    assert found["reference"]["sequence"] == sequence
    parts = [Image.load(path) for path in (tmp_path / "cache" / "references").rglob("*.exr")]
    own = np.mean([p.variance.astype(np.float64).mean() for p in parts if p.variance is not None])
    between = np.var([p.rgb.astype(np.float64) for p in parts], axis=0, ddof=1).mean()
    assert found["reference"]["mse"] * len(parts) == pytest.approx(between, rel=1e-5)
    (variant,) = found["variants"]
    says_nothing = {name for name, why in variant["checks"].items() if why is not None}
    if sequence == "independent":
        assert not says_nothing
        assert between == pytest.approx(own, rel=0.1)
    else:
        assert says_nothing == {"slope", "own_variance"}
        assert between < 0.6 * own
