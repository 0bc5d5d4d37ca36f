"""`furcl bench stages` and `furcl bench waves` on a small scene."""

import json

import pytest
from furcl.bench.stage_bytes import bytes_per_item, functions
from scene_documents import fur_patch

from furcl.bench import stages, waves
from furcl.bench.features import preprocessed
from furcl.device import layout
from furcl.device.features import Features
from furcl.render.renderer import Renderer
from furcl.render.wavefront import STAGES

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
        assert set(rows) == set(STAGES)
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
    results = waves.run([scene], tmp_path, sizes=[256, 64], device=device, rounds=3)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    (found,) = results["scenes"]
    assert [row["size"] for row in found["rows"]] == [256, 64, "chosen"]
    assert found["rows"][0]["ratio"] == 1.0


def test_bytes_of_simple_stages():
    """Counted by hand: planes that the kernel names, queue entries, sums of the film."""
    features = Features(channels=3, light_sampling=False, variance=True)
    # Origin, direction, own segment and distance, throughput, radiance; the queue.
    assert bytes_per_item("generate", features) == 4 * (3 + 3 + 2 + 3 + 3 + 1)
    # Direction, throughput, radiance; the miss queue.
    assert bytes_per_item("shade_escaped", features) == 4 * (3 + 3 + 3 + 1)
    # Radiance; four sums a channel and the number of samples.
    assert bytes_per_item("add_to_film", features) == 4 * (3 + 12 + 1)
    grey = features.with_(channels=1, variance=False)
    assert bytes_per_item("add_to_film", grey) == 4 * (1 + 2 + 1)


def test_every_plane_is_somebodys(device):
    """A plane that the parser overlooked would be in no stage's words."""
    features = Renderer(fur_patch(light_sampling="mis"), device).features
    named = "".join(
        "".join(functions(preprocessed(file, features)).values()) for file in set(STAGES.values())
    )
    for plane in layout.planes(features):
        assert f"PS_{plane}" in named
    for stage, file in STAGES.items():
        assert stage in functions(preprocessed(file, features))
