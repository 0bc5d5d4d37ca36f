"""The ladder: its variants, what is left out of it, its tables and figure."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

if not (Path(__file__).parents[1] / "bench").is_dir():
    pytest.skip("bench/ is not in a source distribution", allow_module_level=True)

import ladder
import ladder_tables
from PIL import Image as Pillow

from furcl.bench.convergence_variants import Variant
from furcl.errors import BenchError
from furcl.scene.read import load_scene

BASE = {"a": "0", "b": "0", "c": "0"}
STEPS = {"first": {"a": "1"}, "second": {"b": "1"}, "third": {"c": "1", "d": "1"}}


def test_rungs_are_the_baseline_each_step_all_without_each_and_all():
    found = ladder.rungs(BASE, STEPS)
    assert list(found) == [
        "baseline", "+ first", "+ second", "+ third",
        "all - first", "all - second", "all - third", "all",
    ]  # fmt: skip
    assert found["baseline"] == BASE
    assert found["+ third"] == {**BASE, "c": "1", "d": "1"}
    assert found["all - first"] == {"a": "0", "b": "1", "c": "1", "d": "1"}
    assert found["all"] == {"a": "1", "b": "1", "c": "1", "d": "1"}


@pytest.mark.parametrize(
    ("n", "names"),
    [(0, ["baseline", "all"]), (1, ["baseline", "all"]),
     (2, ["baseline", "+ first", "+ second", "all"])],
)  # fmt: skip
def test_no_rung_repeats_another(n, names):
    steps = dict(list(STEPS.items())[:n])
    assert list(ladder.rungs(BASE, steps)) == names


def test_steps_that_are_not_known_are_left_out_and_named(monkeypatch):
    monkeypatch.setattr(ladder, "BASELINE", {"sampling": "uniform-h", "nothing": "1"})
    monkeypatch.setattr(
        ladder, "STEPS", {"right": {"light_sampling": "mis"}, "wrong": {"light_sampling": "most"}}
    )
    base, steps, left_out = ladder.known_steps()
    assert base == {"sampling": "uniform-h"}
    assert list(steps) == ["right"]
    assert len(left_out) == 2
    assert "nothing=1 of the baseline" in left_out[0]
    assert "unknown key render.nothing" in left_out[0]
    assert "step 'wrong'" in left_out[1]
    assert "allowed are auto, bcsdf, mis" in left_out[1]


@pytest.mark.parametrize("light", ladder.LIGHTS)
def test_scenes_take_all_variants_of_a_light(light):
    texts = ladder.variants(light)
    names = [Variant.parse(text).name for text in texts]
    assert names[0] == "baseline"
    assert names[-1] == "default"
    assert len(set(names)) == len(names)
    proposed = [name for name in names if name.endswith(ladder.SUFFIX)]
    rungs = [name for name in names[:-1] if not name.endswith(ladder.SUFFIX)]
    assert len(proposed) == (len(rungs) if light == "sky" else 2)
    scene = load_scene("black_hair")
    for text in texts:
        own = Variant.parse(text).scene(scene).render
        assert (own.sampling == "attenuation-cdf") == text.split(":")[0].endswith(ladder.SUFFIX)
    default = Variant.parse(texts[-1]).scene(scene).render
    assert default.light_sampling == "auto"


def test_lights_whose_image_is_not_there_are_refused(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ladder, "IMAGES", tmp_path / "none")
    with pytest.raises(BenchError, match=r"no .*studio\.exr; LIGHTS names the folder"):
        ladder.settings_of("studio")
    with pytest.raises(BenchError, match="no light moon; there are sky, sun"):
        ladder.settings_of("moon")
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "studio.exr").write_bytes(b"")
    assert ladder.settings_of("studio")[0].endswith('file="out/lights/studio.exr"}')
    assert Path("out/lights/studio.exr").is_file()
    assert ladder.settings_of("sky") == ()


# Tables and figure ------------------------------------------------------------------------------


GAINS = {"baseline": 1.0, "baseline (proposed)": 1.25, "all": 8.0, "all (proposed)": 8.0,
         "default": 4.0}  # fmt: skip


def results(scenes=("black_hair", "raccoon")):
    """A run in which MSE = 1 / (gain spp) and a sample takes a tenth of a second and ten rays."""
    return {
        "plan": {
            "spp": [16, 64],
            "runs": 2,
            "variants": [{"name": name, "settings": ["render.sampling=x"]} for name in GAINS],
        },
        "machine": {"processor": "a processor", "cores": 2},
        "device": {"platform": "Portable Computing Language OpenCL 3.0", "driver": "3.1+debian"},
        "date": "2026-11-26",
        "git": "0123456789ab",
        "scenes": [
            {
                "name": scene, "width": 48, "height": 48,
                "variants": [
                    {"name": n, "chosen": {"light_sampling": "mis"} if n == "default" else {}}
                    for n in GAINS
                ],
            }
            for scene in scenes
        ],
        "renders": [
            {
                "scene": scene, "variant": name, "spp": spp, "run": run,
                "rmse": math.sqrt(1.0 / (gain * spp)), "seconds": 0.1 * spp, "rays": 10.0 * spp,
            }
            for scene in scenes for name, gain in GAINS.items() for spp in (16, 64)
            for run in range(2)
        ],
    }  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for light in ("even", "sky"):
        (tmp_path / "ablation" / light).mkdir(parents=True)
        (tmp_path / "ablation" / light / "results.json").write_text(json.dumps(results()))
    return tmp_path


def cells(text: str) -> list[list[str]]:
    """Cells of the rows of a table."""
    rows = [line.strip("| ").split(" | ") for line in text.splitlines()[2:]]
    return [[cell.strip() for cell in row] for row in rows]


def test_the_table_holds_efficiency_time_and_the_proposed_sampler(folder):
    rows = cells(ladder_tables.ladder(folder))
    assert [row[:2] for row in rows[:3]] == [
        ["black_hair", "baseline"], ["black_hair", "all"], ["black_hair", "default"]
    ]  # fmt: skip
    assert rows[0][2:] == ["1", "1", "1", "1.25 [1.25, 1.25]"]
    assert rows[1][2:] == ["8.00 [8.00, 8.00]"] * 2 + ["8.00 [8.00, 8.00] *", "1.00 [1.00, 1.00]"]
    assert rows[2][2:5] == ["4.00 [4.00, 4.00]"] * 3
    assert len(rows) == 6


def test_the_table_of_lights_has_the_scenes_own_first(folder):
    rows = cells(ladder_tables.lights(folder))
    assert [row[:2] for row in rows] == [
        ["black_hair", "sky"], ["raccoon", "sky"], ["black_hair", "even"], ["raccoon", "even"]
    ]  # fmt: skip
    assert rows[0][2:] == ["8.00 [8.00, 8.00]", "4.00 [4.00, 4.00]", "light_sampling = mis"]


def test_an_error_below_that_of_the_reference_has_no_ratio(folder):
    found = results()
    for row in found["renders"]:
        if row["variant"] == "all" and row["run"] == 0:
            row["rmse"] = 0.0
    assert ladder_tables.against(found, "raccoon", "all", "baseline") is None
    assert ladder_tables.against(found, "raccoon", "none", "baseline") is None
    assert ladder_tables.against(found, "raccoon", "default", "baseline") is not None


def test_who_measured_what_is_said(folder):
    text = ladder_tables.settings(folder)
    assert "PoCL 3.1 on a processor, 2 cores, 2026-11-26, commit 0123456789ab" in text
    assert "2 runs; sky 48 x 48 at 16, 64 spp, even 48 x 48 at 16, 64 spp." in text
    assert "* `default`: sampling=x" in text


def test_without_results_the_page_says_how_to_measure(tmp_path):
    for make in ladder_tables.TABLES.values():
        assert "bench/ablation.sh" in make(tmp_path)


def test_the_figure_is_drawn_and_says_from_what(folder, tmp_path):
    import ladder_figure

    path = tmp_path / "ladder.png"
    found = ladder_tables.measured(folder)
    ladder_figure.write(found, path, {ladder_tables.KEY: ladder_tables.digest(folder)})
    with Pillow.open(path) as picture:
        assert picture.info[ladder_tables.KEY] == ladder_tables.digest(folder)
        assert np.asarray(picture.convert("L")).std() > 10.0
    changed = json.loads((folder / "ablation" / "sky" / "results.json").read_text())
    changed["renders"][0]["seconds"] *= 1.5
    (folder / "ablation" / "sky" / "results.json").write_text(json.dumps(changed))
    with Pillow.open(path) as picture:
        assert picture.info[ladder_tables.KEY] != ladder_tables.digest(folder)


def test_the_page_shows_the_figure_of_its_results():
    """The figure is there where there are results, and is of them."""
    if ladder_tables.MAIN not in ladder_tables.measured():
        assert not ladder_tables.FIGURE.exists(), "a figure of no results: remove it"
        return
    with Pillow.open(ladder_tables.FIGURE) as picture:
        assert picture.info[ladder_tables.KEY] == ladder_tables.digest(), (
            "docs/figures/ladder.png is not what python bench/ladder_tables.py draws"
        )
