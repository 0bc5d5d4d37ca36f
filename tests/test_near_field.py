"""Offsets h that are known or lie in a footprint: fibre.mode "near" and "multiscale".

Given h, what a fibre scatters is tested with the far field, which is its mean; here is what chooses
h and lobe within limits, and what light samples are worth there. Where pictures take h from is in
test_near_pictures.py.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cylinders import FIBRES as CYLINDERS
from cylinders import reference_of
from direction_statistics import chi_square_p, sidak
from fibres import FIBRES as DOUBLE
from fibres import YAN2015
from kernel_mutants import substitute
from model_checks import directions
from offset_cells import wo_at
from scene_documents import fur_patch
from test_own_sampler import EXAMPLE

from furcl.errors import FibreError, SamplerError, SceneError
from furcl.fibre import samplers
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.model import check_mode
from furcl.rendering.probe import Probe
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides

FIBRES = {
    "human-black": DOUBLE["human-black"],
    "coloured": DOUBLE["coloured"],
    "chiang": CYLINDERS["chiang"],
    "deon cone, 5 orders": CYLINDERS["deon cone, 5 orders"],
    "yan2015 air": YAN2015["air"],
    "yan2015 dense": YAN2015["dense"],
}
LIMITS = ((-0.95, -0.2), (0.2, 0.6), (-0.3, 0.45), (0.95, 1.0), (0.5042, 0.5047), (0.3, 0.3))
THETA = -0.5
# Limits matter to the choice of lobe and offset alone, which "full-cdf" has in common with
# "attenuation-cdf".
PROBES = [
    *((name, "attenuation-cdf") for name in FIBRES),
    ("human-black", "uniform-h"),
    ("coloured", "full-cdf"),
    ("yan2015 air", "full-cdf"),
    ("yan2015 dense", "uniform-h"),
]
LEVEL = sidak(len(PROBES) * len(LIMITS))
each_probe = pytest.mark.parametrize(("name", "sampling"), PROBES)


def evenly(within: tuple[float, float], n: int) -> np.ndarray:
    """Offsets in the middles of n parts of the limits."""
    low, high = within
    return low + (np.arange(n) + 0.5) * ((high - low) / n)


def energy(probe: Probe, within: tuple[float, float]) -> np.ndarray:
    """Mean (3,) of what all lobes send out over offsets within the limits, in float64."""
    h = evenly(within, 20_000)
    prepared = probe.material.profiles
    lobes = reference_of(probe.fibre).attenuation(probe.fibre, h, THETA, prepared)
    compiled = probe.material.fibre_features.lobes
    return np.sum([a.mean(0) for name, a in lobes.items() if name in compiled], axis=0)


def check_offsets_follow_their_density(probe: Probe, within, seed: int, level: float) -> None:
    """Chi-square of lobe and 40 parts of the limits; a density 3 % too high must be seen in every
    lobe that is chosen for a fifth of the samples."""
    n, parts, fine = 200_000, 40, 50
    low, high = within
    wo = wo_at(THETA)
    _, h, lobe, _, _ = probe.sample(wo, n=n, seed=seed % 2**32, within=within)
    assert h.min() >= low - 1e-7
    assert h.max() <= high + 1e-7
    width = high - low
    cells = np.clip(((h - low) / max(width, 1e-9) * parts).astype(int), 0, parts - 1)
    at = evenly(within, parts * fine)
    density = probe.offset_pdf(wo, at, within).astype(np.float64)
    if width == 0.0:
        cells, expected = np.zeros(n, int), n * density[:, :1]
    else:
        expected = n * width / parts * density.reshape(len(density), parts, fine).mean(2)
    np.testing.assert_allclose(expected.sum(), n, rtol=2e-3)
    counts = [np.bincount(cells[lobe == p], minlength=row.size) for p, row in enumerate(expected)]
    observed, predicted = np.concatenate(counts), expected.ravel()
    assert chi_square_p(observed, predicted * (n / predicted.sum())) > level
    for p, row in enumerate(expected):
        if row.sum() > 0.2 * n and width > 0.0:
            few, wrong = (x.reshape(4, -1).sum(1) for x in (counts[p], 1.03 * row))
            off = chi_square_p(np.append(few, n - few.sum()), np.append(wrong, n - wrong.sum()))
            assert off < level, probe.lobes[p]


def check_mean_weights(probe: Probe, seed: int) -> None:
    """In all limits within 4.5 standard errors of the mean energy there, and 3 % more is not."""
    for i, within in enumerate(LIMITS):
        weight = probe.sample(wo_at(THETA), n=50_000, seed=(seed + i) % 2**32, within=within)[3]
        mean, error = weight.mean(0, dtype=np.float64), weight.std(0) / np.sqrt(len(weight))
        expected = energy(probe, within)
        bound = 4.5 * error + 2e-6 + 2e-4 * expected
        assert np.all(np.abs(mean - expected) < bound), (within, mean, expected)
        assert np.any(np.abs(mean - 1.03 * expected) > bound), within


@pytest.mark.statistical
@each_probe
def test_offsets_within_limits(device, seed, name, sampling):
    """Lobes and offsets have their density; weights have the energy as their mean, and are value
    over density."""
    probe = Probe(FIBRES[name], sampling, device, mode="multiscale")
    check_mean_weights(probe, seed)
    for i, within in enumerate(LIMITS):
        check_offsets_follow_their_density(probe, within, seed + i, LEVEL)
    wo = directions(np.random.default_rng(seed), 4000)
    for within in ((0.2, 0.6), (0.3, 0.3)):
        wi, h, lobe, weight, pdf = probe.sample(wo, seed=seed % 2**32, within=within)
        width = max(within[1] - within[0], 1.0 if within[0] == within[1] else 0.0)
        for p in np.unique(lobe[lobe < len(probe.lobes)]):
            mine = lobe == p
            value = probe.evaluate(wo[mine], wi[mine], h[mine], lobe=int(p)) / width
            density = probe.pdf(wo[mine], wi[mine], h[mine], lobe=int(p), within=within)
            # Directions of profiles may be found again in the next bin.
            same = np.abs(density / pdf[mine] - 1) < 1e-3
            assert same.mean() > 0.98
            ratio = value[same] / density[same, None]
            np.testing.assert_allclose(ratio, weight[mine][same], rtol=1e-3, atol=1e-7)


@pytest.mark.statistical
def test_limits_where_absorption_differs(device, seed):
    """Rows of several absorptions are mixed within the limits too."""
    fibre = Fibre.preset("human-white", sigma_ca=(0.2, 0.9, 2.4))
    probe = Probe(fibre, "full-cdf", device, mode="multiscale", absorbs=(0.1, 4.0))
    check_mean_weights(probe, seed)
    check_offsets_follow_their_density(probe, (-0.3, 0.45), seed, LEVEL)


@each_probe
def test_one_offset_needs_no_tables(device, seed, name, sampling):
    """The near field has the lobes of a footprint of no width, by the same numbers."""
    near = Probe(FIBRES[name], sampling, device, mode="near")
    assert near.material.tables is None
    assert near.material.marginals is None
    wide = Probe(FIBRES[name], sampling, device, mode="multiscale")
    at = (-0.7, -0.7)
    for a, b in zip(
        near.sample(wo_at(THETA), n=2000, seed=seed % 2**32, within=at),
        wide.sample(wo_at(THETA), n=2000, seed=seed % 2**32, within=at),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6)


def towards_z(probe: Probe, seed: int) -> float:
    """Largest difference of light samples from the mean value within limits, in standard errors."""
    n, phi = 20_000, np.array([0.0, 0.5, -0.9, 2.6, -2.9])
    c = np.cos(-THETA)
    wi = np.stack([np.full(5, np.sin(-THETA)), c * np.cos(phi), c * np.sin(phi)], 1)
    z = 0.0
    for i, within in enumerate(((0.2, 0.6), (-0.3, 0.45), (-0.7, -0.7))):
        value, pdf = probe.estimate_far_field(
            wo_at(THETA), np.repeat(wi, n, axis=0), (seed + i) % 2**32, within=within
        )
        assert np.all(pdf >= 0.0)
        found = value[:, 0].reshape(5, n).astype(np.float64)
        h = evenly(within, 4000)[:, None]
        values = reference_of(probe.fibre).evaluate(
            probe.fibre, wo_at(THETA), wi, h, probe.material.profiles
        )
        expected = values[..., 0].mean(0)
        error = found.std(1) / np.sqrt(n) + 1e-3 * expected + 1e-7
        z = max(z, float((np.abs(found.mean(1) - expected) / error).max()))
    return z


@pytest.mark.statistical
@each_probe
def test_light_samples_within_limits(device, seed, name, sampling):
    probe = Probe(FIBRES[name], sampling, device, mode="multiscale", light_sampling=True)
    assert towards_z(probe, seed) < 4.5


OFFSET_MUTANTS = {
    "the footprint is forgotten in the density": (
        r"row\.weight \* 0\.5f \* \(within\.high - within\.low\) / all", "row.weight",
    ),
    "rows are mixed before they are scaled": (
        r"within\.low\) / all", "within.low) / 0.1f",
    ),
    "parts of bins count whole": (r"0\.5f \* \(end - within\.low\)", "0.005f"),
    "h < 0 is searched as h > 0": (r"at < 0\.0f \? FURCL_TABLE_BINS - 1u - size", "false ? 0u"),
}  # fmt: skip


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["human-black", "yan2015 air"])
@pytest.mark.parametrize("mutant", OFFSET_MUTANTS)
def test_wrong_offsets_are_seen(device, seed, monkeypatch, mutant, name):
    substitute(monkeypatch, *OFFSET_MUTANTS[mutant], within="tools/probe.cl")
    probe = Probe(FIBRES[name], "attenuation-cdf", device, mode="multiscale")

    def check_both():
        check_mean_weights(probe, seed)
        for within in LIMITS:
            check_offsets_follow_their_density(probe, within, seed, LEVEL)

    with pytest.raises(AssertionError):
        check_both()


# Scenes ---------------------------------------------------------------------------------------


def test_modes_of_scenes(device):
    """A mode is no parameter of the fibre; it is of a material."""
    scene = with_overrides(fur_patch(), ["fibre.mode=multiscale", "render.spp=2"])
    assert scene.build_fibre() == fur_patch().build_fibre()
    renderer = Renderer(scene, device)
    assert renderer.material.features.mode == "multiscale"
    assert renderer.features.mode == "far"
    renderer.advance(2)
    assert renderer.image().stats["nonfinite"] == 0
    with pytest.raises(SceneError, match=r"fibre\.mode = 'mid'"):
        with_overrides(fur_patch(), ["fibre.mode=mid"])


def test_index_checks_find_nothing(device, monkeypatch):
    monkeypatch.setenv("FURCL_DEBUG", "1")
    for mode in ("near", "multiscale"):
        scene = with_overrides(fur_patch(light_sampling="mis"), [f"fibre.mode={mode}"])
        Renderer(scene, device).advance(2)


@pytest.mark.parametrize("mode", ["near", "multiscale"])
def test_what_has_no_near_field_says_so(device, mode):
    samplers.register("mine", EXAMPLE, needs_tables=True)
    try:
        with pytest.raises(SamplerError, match="chooses h on the whole width"):
            Probe(Fibre(), "mine", device, mode=mode)
    finally:
        samplers.unregister("mine")

    closed: Any = SimpleNamespace(name="closed", has_offset=False)
    with pytest.raises(FibreError, match="has no near field; allowed is 'far'"):
        check_mode(closed, mode)
    check_mode(closed, "far")


@pytest.mark.parametrize(
    ("mode", "within", "message"),
    [
        ("near", None, "within is left out"),
        ("near", (0.1, 0.2), "low = high in mode 'near'"),
        ("multiscale", (0.2, 0.1), "within goes from 0.2 to 0.1"),
        ("multiscale", (0.0, 1.5), "within goes from 0.0 to 1.5"),
        ("multiscale", (0.0, 0.1, 0.2), "within has shape"),
        ("far", (0.0, 0.1), "within is given"),
    ],
)
def test_bad_limits_are_refused(device, mode, within, message):
    probe = Probe(Fibre(), device=device, mode=mode)
    with pytest.raises(FibreError, match=message):
        probe.sample(wo_at(0.0), n=4, within=within)
