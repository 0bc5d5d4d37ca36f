"""The convergence bench: its protocol on a device, and its page."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from biased_sampler import biased_sampler
from model_checks import check_error_falls_as_monte_carlo_does
from scene_documents import even_patch

from furcl.bench import convergence
from furcl.bench.convergence_plan import Plan, quick_scene
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
        ({"sampling": ("full-cdf", "full-cdf")}, "one or more with different names"),
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
    for sampler in found["variants"]:
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
    with biased_sampler(tmp_path, 1.1) as wrong:
        chosen = Plan((even_patch(),), sampling=("uniform-h", wrong), spp=SPP, runs=RUNS)
        results = convergence.run(chosen, tmp_path / "out", device=device)
    found = results["scenes"][0]
    right, wrong_one = (s["spp"][-1]["mean_over_reference"] for s in found["variants"])
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
