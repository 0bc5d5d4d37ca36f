"""Pictures that are merged: the moments of all samples, whatever the order and the cut."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest
from scene_documents import fur_patch

import furcl
from furcl.errors import ImageError, SceneError
from furcl.image.image import Image
from furcl.image.merge import merged
from furcl.image.moments import MergeTree, Moments
from furcl.scene.read import with_overrides

SHAPE = (5, 7, 3)


def _samples(n: int, seed: int) -> np.ndarray:
    """Radiances with rare bright ones, (n, H, W, 3)."""
    return np.random.default_rng(seed).lognormal(0.0, 1.5, (n, *SHAPE)).astype(np.float32)


def _picture(samples: np.ndarray, seed: int = 0, **more: Any) -> Image:
    exact = samples.astype(np.float64)
    n = np.full(SHAPE[:2], len(samples), np.uint32)
    variance = None
    if len(samples) > 1:
        variance = (exact.var(axis=0, ddof=1) / len(samples)).astype(np.float32)
    stats = {"seed": seed, "spp": len(samples), "first_sample": 0}
    return Image(exact.mean(axis=0).astype(np.float32), variance, stats, samples=n, **more)


@pytest.mark.parametrize("sizes", [(3, 4), (2, 2, 2, 2, 2), (64, 2, 17), (100, 2)])
def test_moments_are_those_of_all_samples(sizes):
    parts = [_samples(n, seed) for seed, n in enumerate(sizes)]
    whole = merged(_picture(part, seed) for seed, part in enumerate(parts))
    exact = np.concatenate(parts).astype(np.float64)
    n = sum(sizes)
    np.testing.assert_array_equal(whole.samples, n)
    # Means and variances of the parts are rounded to float32: 2^-24 each, of the largest; measured
    # 6e-8 of the mean, 1.0e-7 of the variance.
    largest = np.maximum.reduce([part.mean(axis=0) for part in parts])
    assert (abs(whole.rgb - exact.mean(axis=0)) <= 2.0**-23 * largest).all()
    assert whole.variance is not None
    np.testing.assert_allclose(whole.variance, exact.var(axis=0, ddof=1) / n, rtol=4e-7)


def test_a_merge_that_forgets_what_lies_between_the_means_is_seen(monkeypatch):
    def without(self: Moments, other: Moments) -> Moments:
        n = self.n + other.n
        mean = self.mean + (other.mean - self.mean) * (other.n / n)[..., None]
        assert self.squares is not None
        assert other.squares is not None
        return Moments(n, mean, self.squares + other.squares)

    monkeypatch.setattr(Moments, "__add__", without)
    with pytest.raises(AssertionError):
        test_moments_are_those_of_all_samples((64, 2, 17))


@pytest.mark.parametrize("n", [1, 2, 5, 6])
def test_the_order_of_parts_changes_no_bit(n):
    parts = [Moments.of(_picture(_samples(3, seed))) for seed in range(n)]
    found = set()
    for order in itertools.islice(itertools.permutations(range(n)), 0, None, 7):
        tree = MergeTree()
        for number in order:
            tree.add(number, parts[number])
        total = tree.total()
        assert total is not None
        assert total.squares is not None
        found.add(total.mean.tobytes() + total.squares.tobytes())
    assert len(found) == 1


def test_parts_that_are_missing_leave_the_others():
    tree = MergeTree()
    for number in (0, 2, 5):
        tree.add(number, Moments.of(_picture(_samples(3, number))))
    total = tree.total()
    assert total is not None
    exact = np.concatenate([_samples(3, number) for number in (0, 2, 5)]).mean(axis=0)
    np.testing.assert_allclose(total.mean, exact, rtol=1e-6)
    assert MergeTree().total() is None


def test_pixels_without_samples_take_those_of_the_other():
    one, other = _picture(_samples(4, 0)), _picture(_samples(6, 1), seed=1)
    assert one.samples is not None
    one.samples[0], one.rgb[0] = 0, 0.0
    whole = merged([one, other])
    np.testing.assert_array_equal(whole.rgb[0], other.rgb[0])
    assert whole.samples is not None
    np.testing.assert_array_equal(whole.samples[:, 0], [6, 10, 10, 10, 10])
    assert whole.stats["samples"] == {"min": 6, "max": 10}


def test_single_samples_have_a_variance_together():
    samples = _samples(2, 0)
    one = [dataclasses.replace(_picture(samples[i : i + 1], i), variance=None) for i in range(2)]
    nan = np.full(SHAPE, np.nan, np.float32)
    whole = merged(dataclasses.replace(image, variance=nan) for image in one)
    exact = samples.astype(np.float64).var(axis=0, ddof=1) / 2
    assert whole.variance is not None
    np.testing.assert_allclose(whole.variance, exact, rtol=1e-6)
    assert merged(one).variance is None


def test_layers_are_weighted_by_what_they_are_means_over():
    shape = SHAPE[:2]
    covered = [np.full(shape, 0.25, np.float32), np.full(shape, 0.75, np.float32)]
    covered[0][0] = 0.0
    depth = [np.full(shape, 2.0, np.float32), np.full(shape, 4.0, np.float32)]
    depth[0][0] = 1e10
    albedo = [np.full(shape, 0.2, np.float32), np.full(shape, 0.6, np.float32)]
    images = [
        _picture(_samples(n, i), i, layers={"A": covered[i], "Z": depth[i], "albedo.R": albedo[i]})
        for i, n in enumerate((4, 12))
    ]
    layers = merged(images).layers
    np.testing.assert_allclose(layers["A"][1:], 0.25 * 0.25 + 0.75 * 0.75)
    np.testing.assert_allclose(layers["albedo.R"], 0.5, rtol=1e-6)
    np.testing.assert_allclose(layers["Z"][1:], (1.0 * 2.0 + 9.0 * 4.0) / 10.0, rtol=1e-6)
    np.testing.assert_array_equal(layers["Z"][0], 4.0)


def _other(**more):
    return lambda image: dataclasses.replace(image, **more)


def _told(**stats):
    return lambda image: dataclasses.replace(image, stats={**image.stats, **stats})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda image: image, "holds samples that picture 0 holds too"),
        (_told(seed=0, first_sample=3), "from sample 3 of seed 0"),
        (_told(seed=0, first_sample=4, allocation="adaptive"), None),
        (_told(seed=0, allocation="adaptive"), "another --seed"),
        (_told(seed=1, scene="b"), "its scene is 'b'"),
        (_told(seed=1, git="abc"), "its git is 'abc'"),
        (_told(seed=None), "do not say which samples"),
        (_told(seed=1, parts=[{"spp": 3}]), "do not say which samples"),
        (_other(variance=None), "has no variance"),
        (_other(layers={"strand": np.zeros(SHAPE[:2], np.float32)}), "has the layers"),
        (_other(samples=None, stats={"seed": 1}), "do not say which samples"),
    ],
)
def test_what_is_refused(change, said):
    first = _picture(_samples(4, 0))
    second = change(_picture(_samples(4, 1)))
    if said is None:
        assert merged([first, second]).stats["spp"] == 8
        return
    with pytest.raises(ImageError, match=said):
        merged([first, second])


@pytest.mark.parametrize(("layer", "said"), [("strand", "no mean"), ("Z", "alpha")])
def test_layers_that_cannot_be_merged_are_named(layer, said):
    values = {layer: np.zeros(SHAPE[:2], np.float32)}
    images = [_picture(_samples(2, seed), seed, layers=values) for seed in (0, 1)]
    with pytest.raises(ImageError, match=rf"picture 0: the layer {layer} .*{said}"):
        merged(images)


def test_one_picture_is_refused():
    with pytest.raises(ImageError, match="two or more"):
        merged([_picture(_samples(2, 0))])


# Rendered parts: with no learning, samples are functions of their numbers alone.


def _scene(**render):
    scene = fur_patch({"preset": "human-black"}, spp=24, **render)
    return with_overrides(scene, size=(24, 16))


@pytest.fixture(scope="module")
def parts(device, tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    for first, end in ((0, 5), (5, 16), (16, 24)):
        furcl.render(_scene(), device=device, samples=(first, end)).save(folder / f"{first}.exr")
    return [folder / f"{first}.exr" for first in (0, 5, 16)]


def test_ranges_of_samples_are_the_samples_of_the_whole(parts, device):
    whole = furcl.render(_scene(), device=device)
    found = merged([Image.load(path) for path in reversed(parts)])
    assert found.samples is not None
    np.testing.assert_array_equal(found.samples, 24)
    # float32 sums and means of each: measured 1.6e-7 of the largest value, 1.2e-6 of the variance.
    np.testing.assert_allclose(found.rgb, whole.rgb, rtol=1e-6, atol=1e-7)
    assert found.variance is not None
    assert whole.variance is not None
    np.testing.assert_allclose(found.variance, whole.variance, rtol=1e-5, atol=1e-9)
    for key in ("paths", "rays", "lobes", "spp"):
        assert found.stats[key] == whole.stats[key]


def test_a_range_that_begins_elsewhere_is_seen(parts, device):
    wrong = furcl.render(_scene(), device=device, samples=(4, 15))
    found = Moments.of(wrong) + Moments.of(Image.load(parts[0])) + Moments.of(Image.load(parts[2]))
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(
            found.mean, furcl.render(_scene(), device=device).rgb, rtol=1e-6, atol=1e-7
        )


@pytest.mark.parametrize(
    "samples", [(3, 3), (-1, 2), (0, 1 << 32), [0, 4], (0, 1.5), (True, 2), "0:4", 4]
)
def test_what_is_no_range_is_refused(samples, device):
    with pytest.raises(SceneError, match="expected \\(first, end\\)"):
        furcl.render(_scene(), device=device, samples=samples)


def test_ranges_of_pixels_with_different_numbers_are_refused(device):
    with pytest.raises(SceneError, match="different numbers of samples"):
        furcl.render(_scene(allocation="adaptive"), device=device, samples=(2, 4))
    with pytest.raises(SceneError, match="give one of both"):
        furcl.render(_scene(), device=device, samples=(2, 4), spp=2)
