"""`furcl bench stages` on a small scene."""

import json

import pytest

from furcl.bench import stages

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
def results(device, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    returned = stages.run(tmp_path / "scene.toml", tmp_path / "out", device=device, spp=2)
    written = json.loads((tmp_path / "out" / "results.json").read_text())
    assert written == json.loads(json.dumps(returned))
    return returned


def test_every_stage_is_timed_and_counted(results):
    rows = {row["stage"]: row for row in results["stages"]}
    assert set(rows) == {
        "generate", "intersect_closest", "shade_escaped", "sample_lobe_h", "shade",
        "intersect_shadow", "add_to_film",
    }  # fmt: skip
    assert results["paths"] == 16 * 16 * 2
    assert results["rays"] >= results["paths"]
    assert sum(row["share"] for row in rows.values()) == pytest.approx(1)
    assert all(row["launches"] >= 1 for row in rows.values())
    assert rows["generate"]["launches"] == rows["add_to_film"]["launches"] == 1
    assert {"device", "machine", "command", "git"} <= set(results)
