"""`furcl bench stages` and `furcl bench waves` on a small scene."""

import json

import pytest

from furcl.bench import stages, waves

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
    returned = stages.run(
        [scene, scene], tmp_path / "out", device=device, spp=2, rounds=3, wave_size=1000
    )
    written = json.loads((tmp_path / "out" / "results.json").read_text())
    assert written == json.loads(json.dumps(returned))
    return returned


def test_every_stage_is_timed_and_counted(results):
    assert {"device", "machine", "command", "git"} <= set(results)
    assert len(results["scenes"]) == 2
    for scene in results["scenes"]:
        rows = {row["stage"]: row for row in scene["stages"]}
        assert set(rows) == set(stages.ITEMS) - {"shade_surface"}
        assert scene["paths"] == 16 * 16 * 2
        assert scene["closest_rays"] == scene["hits"] + scene["misses"] >= scene["paths"]
        assert scene["rays"] == scene["closest_rays"] + scene["shadow_rays"]
        assert sum(row["share"] for row in rows.values()) == pytest.approx(1)
        assert all(row["launches"] >= 1 for row in rows.values())
        assert rows["generate"]["launches"] == rows["add_to_film"]["launches"] == 1
        assert (scene["wave_size"], scene["wave_size_from"]) == (1000, "asked for")
        assert 0.0 < scene["launch_overhead"] < 1.0
        assert 0.0 < scene["end_to_end"] <= 1.0 - scene["launch_overhead"]
        ratio = scene["mrays_s"] / scene["intersect_mrays_s"]
        assert scene["end_to_end"] == pytest.approx(ratio)


def test_wave_sizes_are_compared_with_the_first(device, scene, tmp_path):
    results = waves.run([scene], tmp_path, sizes=[256, 64], device=device, rounds=6)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    (found,) = results["scenes"]
    first, other = found["rows"]
    assert (first["size"], other["size"]) == (256, 64)
    assert first["ratio"] == {"median": 1.0, "low": 1.0, "high": 1.0, "n": 6}
    assert other["ratio"]["low"] <= other["ratio"]["median"] <= other["ratio"]["high"]
    assert (other["cpu_ratio"] is not None) == device.is_cpu
