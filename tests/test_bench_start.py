"""`furcl bench start` times processes that start with empty and with full caches."""

import json

import pytest

from furcl.bench import start as bench
from furcl.errors import FurclError
from furcl.paths import scene_folder

SMALL = ["curves.length=1.0"]


@pytest.mark.slow
def test_cold_and_warm_runs_are_told_apart(device, tmp_path):
    results = bench.run(
        scene_folder() / "single_fibre.toml",
        tmp_path,
        device=device.name,
        size="16x16",
        warm_runs=1,
        overrides=SMALL,
    )
    assert results == json.loads((tmp_path / "results.json").read_text())
    assert len(results["warm"]) == 1
    for run in (results["cold"], *results["warm"]):
        assert 0.0 < run["first_samples"] <= run["end"]
        assert {"curves", "bvh", "tables", "compile", "render"} <= set(run["parts"])
    assert results["compile_everything_seconds"] > 0.0
    assert results["import_seconds"] > 0.0


def test_a_failed_run_says_what_it_printed(device, tmp_path):
    with pytest.raises(FurclError, match="no-such-scene"):
        bench.run(tmp_path / "no-such-scene.toml", tmp_path, device=device.name)
    assert not (tmp_path / "results.json").exists()


def test_compiled_modules_are_kept_between_runs_whatever_the_environment_says(
    monkeypatch, tmp_path
):
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    modules = tmp_path / "modules"
    bench._import_seconds(bench._environment(tmp_path / "caches", modules))
    assert [*modules.rglob("furcl/__init__.*.pyc")]
