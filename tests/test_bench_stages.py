"""`furcl bench stages` and `furcl bench waves` on a small scene."""

import json
from types import SimpleNamespace
from typing import Any, cast

import pytest

from furcl.bench import stages, waves
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene

SCENE = """
[film]
width = 16
height = 16
[fibre]
preset = "human-black"
[environment]
kind = "sky"
[curves]
generator = "fibre"
count = 20
radius = 0.02
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


@pytest.fixture
def results(device, scene, tmp_path):
    returned = stages.run([scene, scene], tmp_path / "out", device=device, spp=2, wave_size=1000)
    written = json.loads((tmp_path / "out" / "results.json").read_text())
    assert written == json.loads(json.dumps(returned))
    return returned


def test_every_stage_is_timed_and_counted(device, scene, results):
    """Counts are those of a render of the same samples."""
    assert {"device", "machine", "command", "git"} <= set(results)
    assert len(results["scenes"]) == 2
    renderer = Renderer(load_scene(scene), device)
    renderer.advance(1)
    before = renderer.rays, renderer.shadow_rays, renderer.lobe_counts[0].sum()
    renderer.advance(2)
    after = renderer.rays, renderer.shadow_rays, renderer.lobe_counts[0].sum()
    rays, shadow_rays, hits = (b - a for a, b in zip(before, after, strict=True))
    for found in results["scenes"]:
        rows = {row["stage"]: row for row in found["stages"]}
        assert set(rows) == set(stages.ITEMS) - {"shade_surface"}
        assert found["paths"] == 16 * 16 * 2
        assert (found["rays"], found["shadow_rays"]) == (rays, shadow_rays)
        assert found["closest_rays"] == rays - shadow_rays == found["hits"] + found["misses"]
        assert found["hits"] == found["fibre_hits"] == hits
        assert all(row["launches"] >= 1 for row in rows.values())
        # A wave ends where the thresholds of roulette are set: after two samples.
        assert rows["generate"]["launches"] == rows["add_to_film"]["launches"] == 2
        assert (found["wave_size"], found["wave_size_from"]) == (1000, "asked for")
        assert 0.0 < found["launch_overhead"] < 1.0
        assert (found["cores_busy"] is not None) == device.is_cpu


class FakeRenderer:
    """Renders for four seconds: 1 s of rays, 2 s of shadow rays, half a second of shading."""

    def __init__(self):
        self.paths_done = self.rays = self.shadow_rays = 0
        self.hits = self.surface_hits = self.misses = 100
        self.wavefront = SimpleNamespace(events={"left over": []}, keep_events=False)
        self.setup = SimpleNamespace(learning=None)
        self.device = SimpleNamespace(is_cpu=True)

    def advance(self, spp):
        self.paths_done += 1_000_000 * spp
        self.rays, self.shadow_rays = 5_000_000 * spp, 2_000_000 * spp
        self.hits += 500_000 * spp
        seconds = {
            "intersect_closest": [0.25, 0.75],
            "intersect_shadow": [2.0],
            "shade": [0.5],
        }
        for stage, times in seconds.items():
            self.wavefront.events[stage] = [
                SimpleNamespace(profile=SimpleNamespace(start=7, end=7 + int(1e9 * t)))
                for t in times
            ]


def test_shares_and_rates_by_hand(monkeypatch):
    clock, cpu = iter([100.0, 104.0]), iter([3.0, 9.0])
    clocks = {"perf_counter": lambda: next(clock), "process_time": lambda: next(cpu)}
    monkeypatch.setattr(stages, "time", SimpleNamespace(**clocks))
    found = stages.timed_round(cast(Any, FakeRenderer()), 2)
    rows = {row["stage"]: row for row in found["stages"]}
    assert (found["paths"], found["rays"], found["closest_rays"]) == (2e6, 1e7, 6e6)
    assert {name: (row["launches"], row["ms"]) for name, row in rows.items()} == {
        "intersect_closest": (2, 1000.0), "intersect_shadow": (1, 2000.0), "shade": (1, 500.0),
    }  # fmt: skip
    rates = {name: row["million_per_second"] for name, row in rows.items()}
    assert rates == pytest.approx({"intersect_closest": 6, "intersect_shadow": 2, "shade": 2})
    shares = [row["share"] for row in rows.values()]
    assert shares == pytest.approx([1 / 3.5, 2 / 3.5, 0.5 / 3.5])
    assert found["launch_overhead"] == pytest.approx(0.5 / 4.0)
    assert (found["mrays_s"], found["mpaths_s"]) == pytest.approx((2.5, 0.5))
    assert found["intersect_mrays_s"] == pytest.approx(10.0 / 3.0)
    assert found["end_to_end"] == pytest.approx(0.75)
    assert found["cores_busy"] == pytest.approx(1.5)


def test_wave_sizes_are_compared_with_the_first(device, scene, tmp_path):
    results = waves.run([scene], tmp_path, sizes=[256, 64], device=device, rounds=6)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    (found,) = results["scenes"]
    first, other = found["rows"]
    assert (first["size"], other["size"]) == (256, 64)
    assert first["ratio"] == {"median": 1.0, "low": 1.0, "high": 1.0, "n": 6}
    assert other["ratio"]["low"] <= other["ratio"]["median"] <= other["ratio"]["high"]
    assert (other["cpu_ratio"] is not None) == device.is_cpu
