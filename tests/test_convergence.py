"""The convergence bench: its statistics, its protocol on a device, and its page."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from model_checks import check_error_falls_as_monte_carlo_does
from scene_documents import even_patch

from furcl.bench import convergence
from furcl.bench.convergence_plan import Plan, quick_scene
from furcl.bench.convergence_statistics import (
    Curve,
    compare_curves,
    interpolate,
    mean_interval,
    ratio_interval,
    slope,
)
from furcl.device.choice import Device
from furcl.errors import BenchError, SamplerError
from furcl.fibre import samplers
from furcl.image.image import Image
from furcl.paths import scene_folder
from furcl.report.convergence import interval, number, write_report
from furcl.scene.read import decode_scene, load_scene
from furcl.scene.tables import Scene

SPP = (4, 8, 16, 32)
RUNS = 8
# Of each interval that a test looks into.
CONFIDENCE = 0.999


# Statistics -------------------------------------------------------------------------------------


def test_mean_interval_of_five_values_by_hand():
    found = mean_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.7764451 * math.sqrt(2.5 / 5.0)
    assert found.mean == 3.0
    assert (found.low, found.high) == pytest.approx((3.0 - half, 3.0 + half), abs=1e-6)
    single = mean_interval([2.0])
    assert single.mean == 2.0
    assert single.as_dict() == {"mean": 2.0, "low": None, "high": None, "n": 1}


def test_intervals_cover_the_truth_as_often_as_they_say(rng):
    """3000 intervals of 5 log-normal values; binomial bounds at alpha 1e-4."""
    n = 3000
    values = np.exp(rng.normal(0.3, 0.2, (n, 5)))
    covered = sum(ratio_interval(row).contains(math.exp(0.3)) for row in values)
    assert abs(covered - 0.95 * n) < 3.9 * math.sqrt(n * 0.95 * 0.05)


def noisy_errors(rng: np.random.Generator, bias: float) -> np.ndarray:
    """(5, 4) RMSE of Monte Carlo over SPP, 1 % noise, with a bias added in squares."""
    return np.sqrt(1.0 / np.array(SPP) + bias**2) * np.exp(rng.normal(0.0, 0.01, (5, 4)))


def test_slope_is_half_for_monte_carlo_and_less_with_a_bias(rng):
    assert slope(SPP, noisy_errors(rng, 0.0), CONFIDENCE).contains(-0.5)
    assert not slope(SPP, noisy_errors(rng, 0.2), CONFIDENCE).contains(-0.5)
    exact = slope(SPP, np.tile(np.array(SPP, float) ** -0.3, (3, 1)))
    assert exact.mean == pytest.approx(-0.3, abs=1e-12)


@pytest.mark.parametrize(
    ("at", "beyond"), [(3.0, False), (1.0, False), (16.0, False), (0.5, True), (40.0, True)]
)
def test_interpolation_follows_power_laws(at, beyond):
    x = np.array([4.0, 1.0, 16.0])
    value, extrapolated = interpolate(at, x, 7.0 * x**-0.5, -0.5)
    assert value == pytest.approx(7.0 * at**-0.5, rel=1e-12)
    assert extrapolated == beyond


def test_a_sampler_of_half_the_variance_is_twice_as_fast():
    spp = np.array(SPP, np.float64)
    seconds = np.array([[1.0], [1.3]]) * spp
    baseline = Curve(spp, seconds, np.tile(spp**-0.5, (2, 1)))
    better = Curve(spp, seconds, np.tile((2.0 * spp) ** -0.5, (2, 1)))
    found = compare_curves(better, baseline)
    assert found["efficiency"]["mean"] == pytest.approx(2.0)
    for row in found["equal_error"]:
        assert row["speed_up"]["mean"] == pytest.approx(2.0)
    for row in found["equal_time"] + found["same_spp"]:
        assert row["rmse_ratio"]["mean"] == pytest.approx(math.sqrt(0.5))
    assert [row["extrapolated"] for row in found["equal_error"]] == [False] * 3 + [True]
    assert found["equal_time"][1]["baseline_spp"] == pytest.approx(SPP[1])


def test_a_slower_sampler_is_compared_with_more_samples_of_the_other():
    spp = np.array(SPP, np.float64)
    baseline = Curve(spp, spp[None], spp[None] ** -0.5)
    slow = Curve(spp, 2.0 * spp[None], spp[None] ** -0.5)
    row = compare_curves(slow, baseline)["equal_time"][0]
    assert row["baseline_spp"] == pytest.approx(2 * SPP[0])
    assert row["rmse_ratio"]["mean"] == pytest.approx(math.sqrt(2.0))


# Plans ------------------------------------------------------------------------------------------


def test_samplers_take_turns():
    plan = Plan((even_patch(),), sampling=("uniform-h", "full-cdf"), spp=(4, 8), runs=2)
    order = list(plan.renders())
    assert [name for _, _, name in order] == ["uniform-h", "full-cdf"] * 4
    assert [run for run, _, _ in order] == [0] * 4 + [1] * 4
    assert plan.reference_spp == 128
    seeds = [plan.seed_of("patch", name, spp, run) for run, spp, name in order]
    assert len(set(seeds)) == len(seeds)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scenes": ()}, "one or more scenes"),
        ({"scenes": (even_patch(), even_patch())}, "different names"),
        ({"spp": (8,)}, "two or more ascending"),
        ({"spp": (8, 4)}, "two or more ascending"),
        ({"runs": 1}, "runs = 1: at least 2"),
        ({"sampling": ("full-cdf", "full-cdf")}, "name each sampler once"),
        ({"reference_spp": 8}, "reference_spp = 8: the reference needs at least"),
    ],
)
def test_plans_that_show_nothing_are_refused(changes, message):
    with pytest.raises(BenchError, match=message):
        Plan(**{"scenes": (even_patch(),), **changes})


def test_unknown_sampler_is_refused():
    with pytest.raises(SamplerError, match="did you mean 'uniform-h'"):
        Plan((even_patch(),), sampling=("uniform-x",))


@pytest.mark.parametrize("name", ["black_hair", "white_hair", "raccoon"])
def test_quick_scenes_are_thinned(name):
    before = load_scene(scene_folder() / f"{name}.toml")
    after = quick_scene(before)
    assert (after.film.width, after.film.height) == (48, 48)
    area = [s.curves.n_strands * s.curves.radius**2 for s in (before, after)]  # pyright: ignore
    assert area[1] == pytest.approx(area[0])


# On a device ------------------------------------------------------------------------------------


class StopAt:
    """A progress function that stops the run when a share of it is done."""

    def __init__(self, share: float) -> None:
        self.share = share
        self.seen: list[tuple[int, int]] = []

    def __call__(self, done: int, total: int) -> bool:
        self.seen.append((done, total))
        return done > self.share * total


def plan() -> Plan:
    return Plan((even_patch(),), sampling=("uniform-h", "attenuation-cdf"), spp=SPP, runs=RUNS)


@pytest.fixture(scope="module")
def cache(device: Device, tmp_path_factory: pytest.TempPathFactory):
    """A cache of its own, so that every device renders its reference."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FURCL_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def stopped_and_continued(
    device: Device, cache: None, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any], dict[str, Any], StopAt]:
    """A run that was stopped among its renders and continued."""
    folder = tmp_path_factory.mktemp("bench")
    stopped = convergence.run(plan(), folder, device=device, progress=StopAt(0.7))
    progress = StopAt(1.0)
    return (
        folder,
        stopped,
        convergence.run(plan(), folder, device=device, progress=progress),
        progress,
    )


@pytest.mark.slow
@pytest.mark.statistical
@pytest.mark.parametrize("sampling", ["uniform-h", "attenuation-cdf"])
def test_error_falls_as_monte_carlo_does(stopped_and_continued, sampling):
    check_error_falls_as_monte_carlo_does(stopped_and_continued[2], sampling)


@pytest.mark.slow
def test_stopped_run_keeps_its_renders_and_goes_on(device, stopped_and_continued, tmp_path):
    _, stopped, continued, progress = stopped_and_continued
    assert not stopped["complete"]
    assert continued["complete"]
    assert 0 < len(stopped["renders"]) < len(continued["renders"]) == 2 * len(SPP) * RUNS
    kept = [{**row} for row in stopped["renders"]]
    assert [r for r in continued["renders"] if r in kept] == kept
    assert progress.seen[-1][0] == progress.seen[-1][1]
    assert progress.seen[-1][1] < plan().samples_a_pixel() * 24 * 24
    whole = convergence.run(plan(), tmp_path, device=device)
    for a, b in zip(whole["renders"], continued["renders"], strict=True):
        assert (a["seed"], a["rays"], a["lobes"]) == (b["seed"], b["rays"], b["lobes"])
        assert a["rmse"] == pytest.approx(b["rmse"], rel=1e-4)


@pytest.mark.slow
def test_results_hold_what_the_schema_says(stopped_and_continued):
    folder, _, results, _ = stopped_and_continued
    assert json.loads((folder / "results.json").read_text()) == results
    found = results["scenes"][0]
    assert found["reference"]["sampling"] in samplers.BUILT_IN
    assert found["reference"]["spp"] == 16 * SPP[-1]
    reference = Image.load(folder / "images" / "patch-reference.exr")
    assert reference.variance is not None
    assert reference.variance.mean() == pytest.approx(found["reference"]["mse"], rel=1e-4)
    for sampler in found["samplers"]:
        assert set(sampler["setup"]) >= {"bvh", "tables", "compile", "first_sample"}
        assert sum(sampler["lobes"]["shares"].values()) == pytest.approx(1.0)
        assert sampler["nonfinite"] == 0
        assert sampler["path_length"] > 1.0
    with (folder / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(results["renders"])
    assert float(rows[0]["rmse"]) == results["renders"][0]["rmse"]


@pytest.mark.slow
def test_page_needs_no_other_file(stopped_and_continued):
    page = write_report(stopped_and_continued[0]).read_text()
    assert page.count("data:image/svg+xml;base64,") == 1
    assert page.count("data:image/png;base64,") == 1
    assert "http" not in page
    assert stopped_and_continued[2]["device"]["name"] in page
    assert (stopped_and_continued[0] / "plots" / "patch-rmse.png").stat().st_size > 10_000


@pytest.mark.slow
def test_renders_of_another_scene_are_not_mixed_in(device, stopped_and_continued):
    other = decode_scene({**_document(even_patch()), "film": {"width": 20, "height": 24}})
    changed = Plan((other,), sampling=("uniform-h", "attenuation-cdf"), spp=SPP)
    with pytest.raises(BenchError, match="holds renders of patch by"):
        convergence.run(changed, stopped_and_continued[0], device=device)


def _document(of: Scene) -> dict[str, Any]:
    import msgspec

    return msgspec.to_builtins(of)


@pytest.mark.slow
def test_a_biased_sampler_is_seen(device, cache, tmp_path):
    """The mutant of the tests above: a sampler that reports a density 10 % too high."""
    text = samplers.find("uniform-h").text()
    assert text.count("r.joint = joint[p];") == 1
    wrong = tmp_path / "wrong.clh"
    wrong.write_text(text.replace("r.joint = joint[p];", "r.joint = 1.1f * joint[p];"))
    samplers.register("wrong", wrong, needs_tables=False)
    try:
        chosen = Plan((even_patch(),), sampling=("uniform-h", "wrong"), spp=SPP, runs=RUNS)
        results = convergence.run(chosen, tmp_path / "out", device=device)
    finally:
        samplers.unregister("wrong")
    found = results["scenes"][0]
    right, wrong_one = (s["spp"][-1]["mean_over_reference"] for s in found["samplers"])
    assert right["low"] < 1.0 < right["high"]
    assert wrong_one["high"] < 0.99
    assert found["reference"]["sampling"] == "uniform-h"


# The page's words -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.5, "0.500"),
        (1, "1"),
        (138.2, "138"),
        (1234.5, "1234"),
        (1.23e-5, "1.23e-05"),
        (None, "-"),
    ],
)
def test_numbers(value, text):
    assert number(value) == text


def test_intervals_in_words():
    assert interval({"mean": 1.0, "low": 0.5, "high": 2.0}) == "1.00 [0.500, 2.00]"
    assert interval({"mean": 1.0, "low": None, "high": None}) == "1.00"
    assert interval(None) == "-"


def test_report_of_nothing_is_refused(tmp_path):
    with pytest.raises(BenchError, match=r"results\.json: cannot be read"):
        write_report(tmp_path)
    (tmp_path / "results.json").write_text("{}")
    with pytest.raises(BenchError, match="not the results of"):
        write_report(tmp_path)
