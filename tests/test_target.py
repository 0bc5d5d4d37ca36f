"""Renders to a target error: what they reach, that they bias nothing, and what they say."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from direction_statistics import sidak
from host_plan import HostFilm, rendered
from scipy import stats

from furcl.device.layout import struct_dtype
from furcl.errors import SceneError
from furcl.image.error import estimated_errors
from furcl.rendering.plan import SamplePlan
from furcl.rendering.target import Target


def _samples(rng, shape, n):
    """Samples (H, W, n), whose deviation grows from left to right from 0.1 to 3 and whose mean from
    top to bottom, and these means (H, W)."""
    deviation = np.geomspace(0.1, 3.0, shape[1])
    truth = np.broadcast_to(np.linspace(0.5, 2.0, shape[0])[:, None], shape)
    noise = rng.exponential(1.0, (*shape, n)) - 1.0
    return truth[..., None] + deviation[:, None] * noise, truth


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("target", [Target(0.12, False), Target(0.01, True)])
def test_the_target_is_reached(rng, even, target):
    """On average over renders, with the fewest samples that do it within 15 %, which the known
    deviations tell. The estimate of relMSE divides by means that are estimates: where those of
    some pixels are off by a third, as in the even render here, it is too large (measured: 1.27)."""
    too_large = 1.3 if even and target.relative else 1.0
    reached, spent = [], []
    limit = target.value if target.relative else target.value**2
    for _ in range(8):
        values, truth = _samples(rng, (32, 32), 1500)
        film, _ = rendered(values, 1000, even, target)
        mean = film.read()[0][..., 0]
        weight = 1.0 / (truth**2 + 0.01) if target.relative else np.ones_like(truth)
        reached.append(np.mean(weight * (mean - truth) ** 2))
        variance = weight * np.geomspace(0.1, 3.0, 32) ** 2
        least = variance.mean() if even else np.sqrt(variance).mean() ** 2
        spent.append(film.counts.mean() / (least / limit))
    assert 0.93 / too_large < np.mean(reached) / limit < 1.07
    assert 0.93 < np.mean(spent) < 1.15 * too_large


def test_samples_that_were_asked_for_are_the_most(rng):
    values, _ = _samples(rng, (16, 16), 400)
    film, plan = rendered(values, 20, target=Target(1e-4, False))
    assert film.counts.sum() == 20 * 256
    assert plan.paths_needed == 20 * 256


def test_nothing_to_do_ends_at_once(rng):
    film, _ = rendered(np.ones((8, 8, 50)), 50, target=Target(0.01, False))
    assert np.all(film.counts == 4)


@pytest.mark.statistical
@pytest.mark.parametrize("own", [False, True])
def test_stopping_biases_nothing(rng, monkeypatch, own):
    """Pictures of 64 pixels with rare bright samples. Mutant: a colour stops by its own errors,
    which look small as long as nothing bright came (measured: 5 % too dark, 10 standard errors; and
    in pictures of eight pixels, where the rule's own 3 % show as well, 33 %)."""
    if own:
        prepare = SamplePlan.__init__

        def prepare_wrongly(self, *arguments):
            prepare(self, *arguments)
            self._others = self._colours

        monkeypatch.setattr(SamplePlan, "__init__", prepare_wrongly)
    excess = []
    for _ in range(800):
        values = 16.0 * (rng.random((8, 8, 800), np.float32) < 1 / 16)
        film, _ = rendered(values.astype(np.float64), 100, target=Target(1.0, False))
        excess.append(np.mean(film.read()[0]) - 1.0)
    z = np.mean(excess) / stats.sem(excess)
    p = 2.0 * stats.t.sf(abs(z), len(excess) - 1)
    assert p < sidak(2) if own else p > sidak(2)


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["rmse", "relmse"])
@pytest.mark.parametrize("shape", [(32, 32), (15, 15)])
def test_the_interval_holds_the_error(rng, name, shape):
    """In at least 95 % of 400 pictures, up to what chance explains; a tenth of it holds few."""
    inside = tenth = 0
    for _ in range(400):
        values, truth = _samples(rng, shape, 64)
        mean = np.repeat(values.mean(axis=2)[..., None], 3, 2)
        variance = np.repeat(values.var(axis=2, ddof=1)[..., None] / 64, 3, 2)
        found = estimated_errors(mean, variance)
        assert found is not None
        error = (mean[..., 0] - truth) ** 2
        error = np.mean(error / (truth**2 + 0.01)) if name == "relmse" else np.sqrt(error.mean())
        low, high, middle = (found[name][key] for key in ("low", "high", "estimate"))
        inside += low <= error <= high
        tenth += abs(error - middle) <= 0.05 * (high - low)
    assert stats.binomtest(inside, 400, 0.95, "less").pvalue > sidak(4)
    assert stats.binomtest(tenth, 400, 0.5, "less").pvalue < 1e-6


def test_an_unknown_variance_makes_the_error_unknown():
    mean = np.ones((2, 2, 3), np.float32)
    assert estimated_errors(mean, np.full_like(mean, np.nan)) is None


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["rmse", "relmse"])
def test_targets_that_are_none_are_refused(name, value):
    with pytest.raises(SceneError, match=f"target_{name} = .*: allowed is a finite number above 0"):
        Target.of(**{"rmse": None, "relmse": None, name: value})


def test_two_targets_are_refused():
    with pytest.raises(SceneError, match="two targets; allowed is one"):
        Target.of(0.1, 0.1)
    assert Target.of(None, None) is None


def test_more_samples_may_be_asked_for_later(rng):
    """A render that ran out of samples goes on to its target."""
    values, _ = _samples(rng, (16, 16), 1000)
    memory: Any = SimpleNamespace(device=SimpleNamespace(queue=None))
    film: Any = HostFilm(values)
    plan = SamplePlan(memory, film, True, Target(0.2, False))
    wave = np.zeros((), struct_dtype("Wave"))
    for spp in (10, 1000):
        while film.counts.sum() < spp * 256 and plan.cut(wave, 1 << 40, spp):
            film.counts = plan.counts
        assert spp != 10 or film.counts.sum() == 2560
    assert 30 < film.counts.mean() < 120
    assert not plan.cut(wave, 1 << 40, 1000)
