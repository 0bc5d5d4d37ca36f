"""Folders of convergence runs: what is gone on with, what is refused; names that are no paths."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_documents import even_patch

from furcl.bench import convergence
from furcl.bench.convergence_plan import Plan
from furcl.device.choice import Device
from furcl.errors import BenchError, SceneError
from furcl.files import file_name
from furcl.image.image import Image
from furcl.paths import cache_folder
from furcl.report import convergence_plots as plots
from furcl.report.convergence import write_report
from furcl.scene.read import load_scene, with_overrides

NAMES = ["a|b", r"$\frac$", "../../up", "/etc/x", "..", "é ü", "x" * 255, "%2E", "a$b$c"]


def _plan(name: str = "patch", **changes: Any) -> Plan:
    scene = with_overrides(even_patch(), [f"name={json.dumps(name)}"], size=(8, 8))
    return Plan((scene,), sampling=("uniform-h",), **{"spp": (2, 4), "runs": 2, **changes})


@pytest.fixture(scope="module")
def done(device: Device, tmp_path_factory: pytest.TempPathFactory):
    """A finished run, with a cache of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FURCL_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        folder = tmp_path_factory.mktemp("done")
        results = convergence.run(_plan(), folder, device=device)
        yield folder, results


@pytest.fixture
def again(done, tmp_path) -> Path:
    """A copy of its folder."""
    return Path(shutil.copytree(done[0], tmp_path / "again"))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"seed": 2}, "with another seed than 2; continue with the --seed"),
        ({"reference_spp": 128}, "a reference of 64 samples a pixel, not 128"),
        ({"spp": (2, 4, 8)}, "a reference of 64 samples a pixel, not 128"),
    ],
)
def test_another_plan_is_refused(changes, said, device, again):
    with pytest.raises(BenchError, match=re.escape(said)):
        convergence.run(_plan(**changes), again, device=device)


@pytest.mark.parametrize("changes", [{"runs": 3}, {"spp": (2, 4, 8), "reference_spp": 64}])
def test_more_of_the_same_plan_is_added(changes, device, done, again):
    results = convergence.run(_plan(**changes), again, device=device)
    assert [row for row in results["renders"] if row in done[1]["renders"]] == done[1]["renders"]
    assert len(results["renders"]) > len(done[1]["renders"])


def _without(name):
    def change(state):
        del next(iter(state["renders"].values()))[name]
        return state

    return change


def _key(state):
    state["renders"]["patch|uniform-h|x|0"] = next(iter(state["renders"].values()))
    return state


@pytest.mark.parametrize(
    "change",
    [
        lambda _: [],
        lambda _: None,
        lambda _: 3,
        lambda _: {},
        lambda s: {**s, "renders": []},
        lambda s: {**s, "renders": {"a": 3}},
        lambda s: {**s, "scenes": {"patch": {}}},
        lambda s: {**s, "setup": {"patch|uniform-h": None}},
        _without("lobes"),
        _without("seed"),
        _key,
    ],
)
def test_states_that_are_none_are_refused(change, device, again):
    path = again / "renders.json"
    path.write_text(json.dumps(change(json.loads(path.read_text()))))
    with pytest.raises(BenchError, match=r"renders\.json: .*remove it to start again"):
        convergence.run(_plan(), again, device=device)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\xff"])
def test_states_that_are_no_json_are_refused(text, device, again):
    (again / "renders.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(BenchError, match=r"renders\.json: .*remove it to start again"):
        convergence.run(_plan(), again, device=device)


def _other_pixel(path):
    image = Image.load(path)
    image.rgb[0, 0, 0] += np.float32(1e-3)
    image.save(path)


def _other_statistics(path):
    image = Image.load(path)
    image.stats["wall_seconds"] += 1.0
    image.save(path)


def _smaller(path):
    image = Image.load(path)
    replace(image, rgb=image.rgb[:4], variance=None, samples=None).save(path)


@pytest.mark.parametrize(
    "damage",
    [
        _other_pixel,
        _other_statistics,
        _smaller,
        lambda path: Image(Image.load(path).rgb).save(path),
        lambda path: path.write_bytes(path.read_bytes()[:-100]),
        lambda path: path.write_bytes(b""),
    ],
)
def test_damaged_parts_of_references_are_rendered_again(damage, device, done, tmp_path, caplog):
    parts = sorted((cache_folder() / "references").rglob("part*.exr"))
    assert len(parts) == 8
    whole = parts[2].read_bytes()
    damage(parts[2])
    results = convergence.run(_plan(), tmp_path, device=device)
    same = ("mean", "mse", "key")
    found, before = (r["scenes"][0]["reference"] for r in (results, done[1]))
    assert {name: found[name] for name in same} == {name: before[name] for name in same}
    assert "rendering this part again" in caplog.text
    assert np.array_equal(Image.load(parts[2]).rgb, Image.load(parts[3]).rgb) is False
    assert len(parts[2].read_bytes()) == pytest.approx(len(whole), rel=0.05)


# Names ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_no_path(name, device, done, tmp_path):
    folder = tmp_path / "a" / "b" / "out"
    folder.mkdir(parents=True)
    results = convergence.run(_plan(name), folder, device=device)
    write_report(folder)
    assert results["scenes"][0]["name"] == name
    assert results["complete"]
    assert convergence.run(_plan(name), folder, device=device)["renders"] == results["renders"]
    assert [path.relative_to(tmp_path).parts[:3] for path in tmp_path.rglob("*.*")] == [
        ("a", "b", "out")
    ] * len([*tmp_path.rglob("*.*")])
    assert {path.name for path in folder.iterdir()} == {
        "images", "plots", "index.html", "renders.json", "results.csv", "results.json",
    }  # fmt: skip


def test_other_names_are_other_files():
    texts = [*NAMES, "patch", "A_b-c (1).x=~", "a b", "a/b", "a\\b", "x" * 256, "x" * 254, "%"]
    found = [file_name(text) for text in texts]
    assert len(set(found)) == len(texts)
    assert all(re.fullmatch(r"[\w+.()=~% -]{1,100}", name, re.ASCII) for name in found)
    assert not any(name.startswith(".") for name in found)
    assert file_name("A_b-c (1).x=~") == "A_b-c (1).x=~"


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31m", "x" * 256, "\u2028"])
def test_names_that_no_line_shows_are_refused(name):
    with pytest.raises(SceneError, match=r"name = .*: expected at most 255 printable characters"):
        with_overrides(even_patch(), [f"name={json.dumps(name)}"])


def test_a_file_of_any_name_is_a_scene(tmp_path):
    path = tmp_path / "a\n\udcff$x.toml"
    path.write_bytes((Path(__file__).parents[1] / "scenes/single_fibre.toml").read_bytes())
    assert load_scene(path).name == "a\\n\\udcff$x"


# Figures of few runs ----------------------------------------------------------------------------

_NONE: dict[str, Any] = {"low": None, "high": None}


@pytest.mark.parametrize(
    "estimate",
    [
        {"mean": 0.3, "low": 0.0, "high": np.inf},
        {"mean": 0.3, "low": 1e-300, "high": 1e300},
        {"mean": 0.0, "low": -1.0, "high": 1.0},
        {"mean": np.inf, **_NONE},
        {"mean": np.nan, **_NONE},
        {"mean": None, **_NONE},
    ],
)
@pytest.mark.parametrize("where", ["rmse", "rmse_ratio"])
def test_figures_of_intervals_without_end(estimate, where, done, tmp_path):
    scene = json.loads(json.dumps(done[1]["scenes"][0]))
    scene["comparisons"] = [
        {
            "variant": "uniform-h",
            "baseline": "uniform-h",
            "equal_time": [{"spp": n, "rmse_ratio": {"mean": 0.3, **_NONE}} for n in (2, 4)],
        }
    ]
    rows = scene["variants"][0]["spp"] if where == "rmse" else scene["comparisons"][0]["equal_time"]
    for row in rows:
        row[where] = estimate
    figure = plots.error_over_time(scene)
    plots.save(figure, tmp_path / "a.svg")
    for axes in figure.axes:
        low, high = axes.get_ylim()
        assert -1.0 < low < high < 1e6
