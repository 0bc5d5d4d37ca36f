"""`furcl bench intersect` on small grooms: it runs, agrees with Embree and says who measured."""

from __future__ import annotations

import json

import numpy as np
import pytest

from furcl.bench import intersect
from furcl.bench.ray_sets import ray_sets
from furcl.errors import GroomError
from furcl.oracle.embree_rays import EmbreeScene
from furcl.rendering.rays import Tracer


def test_bench_measures_four_kinds_of_rays(device, tmp_path):
    results = intersect.run("fur:7000", tmp_path, device=device, size=64, rounds=1)
    assert json.loads((tmp_path / "results.json").read_text()) == results
    assert [row["kind"] for row in results["rays"]] == ["primary", "bounce1", "bounce4", "shadow"]
    for row in results["rays"]:
        assert row["disagreements"] < 1e-3
        assert 0.01 < row["hit"] < 0.99
        assert row["mrays_s"] > 0.0
    assert results["segments"] == 7000
    assert results["device"]["driver"] == device.driver_version


@pytest.fixture
def small_bench(device):
    """A tracer of a small groom, the rays of a picture of it by kind, and Embree's scene."""
    curves, camera = intersect.groom_and_camera("fur:7000")
    scene = EmbreeScene(curves)
    sets = {rays.name: rays for rays in ray_sets(curves, camera, 16, scene, 1)}
    return Tracer(device, curves), sets, scene


def test_rates_are_medians_and_ratios_are_taken_round_by_round(small_bench, monkeypatch):
    """By hand: seconds of 1, 2 and 8 against Embree's 2, 2 and 4; processor seconds are twice as
    many of ours."""
    tracer, sets, scene = small_bench
    clock = iter([(1.0, 2.0), (2.0, 2.0), (2.0, 4.0), (2.0, 2.0), (8.0, 16.0), (4.0, 4.0)])
    monkeypatch.setattr(intersect, "_timed", lambda action: next(clock))
    row = intersect._measure(tracer, scene, sets["primary"], 3)
    assert row["n"] == 16 * 16
    assert row["mrays_s"] == pytest.approx(256e-6 / 2.0)
    assert row["embree_mrays_s"] == pytest.approx(256e-6 / 2.0)
    assert row["ratio"] == pytest.approx(1.0)  # the median of 2, 1 and 0.5
    if tracer.device.is_cpu:
        assert row["cpu_ratio"] == pytest.approx(0.5)


@pytest.mark.parametrize("kind", ["primary", "shadow"])
def test_a_tracer_of_another_groom_disagrees(small_bench, kind):
    tracer, sets, scene = small_bench
    other = Tracer(tracer.device, intersect.groom_and_camera("fur:3500")[0])
    assert intersect._measure(tracer, scene, sets[kind], 1)["disagreements"] < 1e-2
    assert intersect._measure(other, scene, sets[kind], 1)["disagreements"] > 0.1


def test_disagreements_are_seen():
    t = np.array([1.0, 2.0, 3.0, 4.0])
    segment = np.array([1, 2, 3, 0xFFFFFFFF], np.uint32)
    ours = t, segment, t
    theirs = t * [1.0, 1.0 + 2e-4, 1.0 + 5e-5, 1.0], np.array([7, 7, 7, 3], np.uint32), t
    assert intersect._disagreements(ours, ours, False) == 0.0
    assert intersect._disagreements(ours, theirs, False) == 0.5
    assert intersect._disagreements(np.array([True, False]), np.array([True, True]), True) == 0.5


@pytest.mark.parametrize("name", ["hair:15000", "fur:7000", "hair:1"])
def test_generated_grooms_have_the_size_asked_for(name):
    curves, camera = intersect.groom_and_camera(name)
    wanted = int(name.partition(":")[2])
    assert wanted - 15 < curves.n_segments < wanted + 15
    assert camera.origin is not None


def test_heads_get_finer_and_other_grooms_thinner(monkeypatch):
    monkeypatch.setattr(intersect, "HEAD_STRANDS", 1000)
    coarse, fine = (intersect.groom_and_camera(name)[0] for name in ("head:6000", "head:60999"))
    assert (coarse.n_strands, coarse.n_segments) == (1000, 6000)
    assert (fine.n_strands, fine.n_segments) == (1000, 60000)
    assert np.median(fine.radii[fine.offsets[:-1]]) == pytest.approx(
        np.median(coarse.radii[coarse.offsets[:-1]]), rel=0.05
    )
    few, many = (intersect.groom_and_camera(name)[0] for name in ("hair:15000", "hair:150000"))
    thinner = np.median(few.radii[few.offsets[:-1]]) / np.median(many.radii[many.offsets[:-1]])
    assert thinner == pytest.approx(np.sqrt(10.0), rel=0.1)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hair:many", "'many' is not a number of segments"),
        ("head:599999", "100000 strands that wave have at least 600000 segments"),
    ],
)
def test_a_wrong_size_is_refused(name, message):
    with pytest.raises(GroomError, match=message):
        intersect.groom_and_camera(name)


def test_rays_are_tiled_and_shuffled():
    curves, camera = intersect.groom_and_camera("fur:7000")
    sets = {rays.name: rays for rays in ray_sets(curves, camera, 64, EmbreeScene(curves), 1)}
    step = {
        name: np.linalg.norm(np.diff(rays.directions[:, :3], axis=0), axis=1).mean()
        for name, rays in sets.items()
    }
    assert step["primary"] < 0.1 < step["bounce1"]
    near = {
        name: np.linalg.norm(np.diff(sets[name].origins[:, :3], axis=0), axis=1).mean()
        for name in ("bounce1", "bounce4")
    }
    assert near["bounce1"] < 0.5 * near["bounce4"]
    for rays in sets.values():
        length = np.linalg.norm(rays.directions[:, :3], axis=1)
        assert np.abs(length - 1.0).max() < 1e-6
