"""Benchmarks that the workers of a cluster share: what is found is as with one device."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clusters import Kill, local_cluster, spec_of, workers_of
from command_lines import run
from scene_documents import even_patch

from furcl.bench import convergence, stability
from furcl.bench.convergence_plan import Plan
from furcl.bench.stability_cylinder import CHIANG_SUBJECT
from furcl.bench.stability_steps import COMPARED, LOOKED_AT, Found, Sweep, in_order
from furcl.device.choice import Device
from furcl.distributed import tasks
from furcl.distributed.tasks import Shared, Workers
from furcl.errors import BenchError, DeviceError, SamplerError
from furcl.fibre import samplers
from furcl.image.image import Image
from furcl.paths import kernel_folder
from furcl.report.convergence import write_report
from furcl.report.stability import write_report as write_stability

N_RENDERS = 12
TIMES = {"seconds", "cpu_seconds"}


def _plan(**changes: Any) -> Plan:
    values = {"sampling": ("uniform-h", "attenuation-cdf"), "spp": (2, 4), "runs": 3}
    return Plan((even_patch(),), **{**values, **changes})


class StopAt:
    """A progress function that stops a run when a share of it is done."""

    def __init__(self, share: float) -> None:
        self.share = share

    def __call__(self, done: int, total: int) -> bool:
        return done > self.share * total


def _without_times(renders: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{key: row[key] for key in row if key not in TIMES} for row in renders]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of its own: no test finds the references of another. Workers that are started anew
    have it too; sweeps, which need simulated medullae, come before them."""
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with local_cluster() as client:
        yield client


@pytest.fixture(scope="module")
def alone(device: Device, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A run by one device, and its folder."""
    folder = tmp_path_factory.mktemp("alone")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FURCL_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        return folder, convergence.run(_plan(), folder, device=device)


def _check_same(found: dict[str, Any], alone: tuple[Path, dict[str, Any]]) -> None:
    """The same records, reference and settings; other times."""
    expected = alone[1]
    assert found["complete"]
    assert _without_times(found["renders"]) == _without_times(expected["renders"])
    assert len(found["renders"]) == N_RENDERS
    (mine,), (its,) = (each["scenes"] for each in (found, expected))
    assert {**mine["reference"], "seconds": 0.0} == {**its["reference"], "seconds": 0.0}
    for a, b in zip(mine["variants"], its["variants"], strict=True):
        assert a.keys() == b.keys()
        for key in ("name", "settings", "chosen", "compiled", "checks", "lobes"):
            assert a[key] == b[key]
    assert found["device"] == expected["device"]
    assert found.keys() - {"workers"} == expected.keys()


# Stability --------------------------------------------------------------------------------------


OPTIONS: dict[str, Any] = {
    "quick": True, "n_points": 26_000, "n_compared": 6_000, "renders": False, "seed": 4,
    "subject": CHIANG_SUBJECT,
}  # fmt: skip
OF_A_RUN = {"command", "date", "git", "version", "workers"}


@pytest.mark.slow
def test_workers_sweep_as_one_device_does(cluster, device, tmp_path):
    said: list[tuple[str, int, int]] = []
    one = stability.run(tmp_path / "one", device=device, **OPTIONS)
    shared = stability.run(
        tmp_path / "shared", device=spec_of(device), client=cluster,
        progress=lambda *step: said.append(step), **OPTIONS,
    )  # fmt: skip
    assert shared["workers"] == 2
    assert json.loads((tmp_path / "shared" / "results.json").read_text())["workers"] == 2
    assert "2 workers" in write_stability(tmp_path / "shared").read_text()
    for key in one.keys() | shared.keys():
        if key not in OF_A_RUN:
            assert one[key] == shared[key], key
    assert [step for step in said if step[0] == LOOKED_AT] == [(LOOKED_AT, 1, 2), (LOOKED_AT, 2, 2)]
    assert len(one["rows"]) > 20
    assert len(one["parameters"]) == -(-len(list(CHIANG_SUBJECT.grid())) // 3)


@pytest.mark.slow
def test_stiff_scenes_are_shared_too(cluster, device, tmp_path, monkeypatch):
    """All steps but one fibre of a kind and the scenes are left out."""
    monkeypatch.setattr(Sweep, "steps_apart", _few(Sweep.steps_apart))
    monkeypatch.setattr(Sweep, "steps", _few(Sweep.steps))
    found = [
        stability.run(
            tmp_path / str(client is None), device=chosen, client=client, quick=True, n_points=2000
        )
        for client, chosen in ((cluster, spec_of(device)), (None, device))
    ]
    for results in found:
        assert {row.pop("seconds") > 0.0 for row in results["renders"]} == {True}
    assert found[0]["renders"] == found[1]["renders"]
    assert len(found[0]["renders"]) == 2
    assert found[0]["rows"] == found[1]["rows"]


def _few(real: Any) -> Any:
    """Of the steps of a sweep one fibre that is compared, the reference, and two scenes."""

    def steps(self: Sweep, seed: int) -> Any:
        kept = {(COMPARED, 0), ("integrals", 3), ("renders", 2), ("renders", 3)}
        numbers = iter(range(len(kept)))
        for step in real(self, seed):
            if (step.part, step.number) in kept:
                yield replace(step, index=next(numbers))
            elif real.__name__ == "steps" and step.rng is not None:
                step.draw(self)

    return (lambda self, seed: list(steps(self, seed))) if real.__name__ != "steps" else steps


@pytest.mark.slow
def test_a_lost_worker_costs_a_sweep_nothing(cluster, device, tmp_path):
    cluster.wait_for_workers(2, timeout=60)
    kill = Kill(cluster, 1)
    options = {**OPTIONS, "n_points": 4000, "n_compared": 4000}
    one = stability.run(tmp_path / "one", device=device, **options)
    shared = stability.run(
        tmp_path / "shared", device=spec_of(device), client=cluster,
        progress=lambda _, *done: kill.when(*done), **options,
    )  # fmt: skip
    assert len(kill.killed) == 1
    assert one["rows"] == shared["rows"]
    assert one["weights"] == shared["weights"]
    cluster.wait_for_workers(2, timeout=60)


def test_steps_apart_are_drawn_as_those_in_turn():
    sweep = Sweep.of(CHIANG_SUBJECT, True, 4000, 20_000, renders=False)
    drawn = [step.draw(sweep) for step in sweep.steps(3)]
    apart = [step.draw(sweep) for step in reversed(sweep.steps_apart(3))]
    assert len(drawn) == sweep.fibres["grid"] + 2 + 2
    for (fibre, points), (its, those) in zip(drawn, reversed(apart), strict=True):
        assert fibre == its
        assert np.array_equal(points.wi, those.wi)
    assert drawn[-1][0] != drawn[-2][0]


def test_results_are_put_in_their_order():
    steps = list(Sweep.of(CHIANG_SUBJECT, True, 2000, 0, renders=False).steps_apart(1))[:4]
    found = [Found() for _ in steps]
    given: list[int] = []

    def coming() -> Iterator[tuple[Any, Found]]:
        for index in (1, 0, 3, 2):
            given.append(index)
            yield steps[index], found[index]

    seen = []
    for step, one in in_order(coming()):
        assert one is found[step.index]
        seen.append((step.index, len(given)))
    assert seen == [(0, 2), (1, 2), (2, 4), (3, 4)]


# Convergence ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_workers_find_what_one_device_finds(cluster, alone, device, cache, tmp_path):
    seen: list[tuple[int, int]] = []
    found = convergence.run(
        _plan(), tmp_path, device=spec_of(device), client=cluster,
        progress=lambda *n: seen.append(n),
    )  # fmt: skip
    _check_same(found, alone)
    assert found["workers"] == 2
    assert "workers" not in alone[1]
    assert json.loads((tmp_path / "results.json").read_text()) == found
    assert seen[-1] == (seen[-1][1], seen[-1][1])
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    names = {path.name for path in (alone[0] / "images").iterdir()}
    assert len(names) == 1 + 2 * 2
    assert {path.name for path in (tmp_path / "images").iterdir()} == names
    for name in names:
        one, other = (Image.load(folder / "images" / name) for folder in (tmp_path, alone[0]))
        assert np.array_equal(one.rgb, other.rgb)
    assert "2 workers" in write_report(tmp_path).read_text()


@pytest.mark.slow
def test_a_run_goes_on_with_workers_or_without(cluster, alone, device, cache, tmp_path):
    """Begun by one device, gone on with by workers until that is stopped, ended by one device."""
    begun = convergence.run(_plan(), tmp_path, device=device, progress=StopAt(0.75))
    assert 0 < len(begun["renders"]) < N_RENDERS
    more = convergence.run(
        _plan(), tmp_path, device=spec_of(device), client=cluster, progress=StopAt(0.3)
    )
    assert not more["complete"]
    assert len(begun["renders"]) < len(more["renders"]) < N_RENDERS
    for earlier in begun["renders"]:
        assert earlier in more["renders"]
    found = convergence.run(_plan(), tmp_path, device=device)
    for earlier in more["renders"]:
        assert earlier in found["renders"]
    _check_same(found, alone)
    assert found["workers"] in (1, 2)


@pytest.mark.slow
@pytest.mark.parametrize("most", [1, 2])
def test_lost_workers_cost_no_render(cluster, alone, device, cache, tmp_path, most):
    """One among the renders; all, with the scene."""
    cluster.wait_for_workers(2, timeout=60)
    kill = Kill(cluster, most, 0.8)
    found = convergence.run(
        _plan(), tmp_path, device=spec_of(device), client=cluster, progress=kill
    )
    assert len(kill.killed) == most
    _check_same(found, alone)
    cluster.wait_for_workers(2, timeout=60)


@pytest.mark.slow
def test_a_stop_is_heard_while_nothing_is_ready(cluster, device, cache, tmp_path):
    """Asked three times before any sample is there."""
    calls: list[int] = []

    def progress(done: int, total: int) -> bool:
        calls.append(done)
        return len(calls) >= 3

    found = convergence.run(
        _plan(), tmp_path, device=spec_of(device), client=cluster, progress=progress
    )
    assert calls == [0, 0, 0]
    assert (found["complete"], found["renders"], found["scenes"]) == (False, [], [])
    assert found["device"]["name"] == device.name


@pytest.mark.slow
@pytest.mark.parametrize("name", ["convergence", "stability"])
def test_workers_with_another_driver_are_refused(cluster, device, cache, tmp_path, name):
    cluster.wait_for_workers(2, timeout=60)
    one, other = workers_of(cluster)
    cluster.run(_with_another_driver, workers=[other])
    options: dict[str, Any] = {"device": spec_of(device), "client": cluster}
    try:
        with pytest.raises(DeviceError) as error:
            _run(name, tmp_path, **options)
    finally:
        cluster.run(_with_its_own_driver, workers=[other])
    for part in (one, other, device.name, device.driver_version, "another driver", "--device"):
        assert part in str(error.value)
    assert not (tmp_path / "results.json").exists()


def _with_another_driver() -> None:
    """Let this process say that its device has another driver."""
    from furcl.device.choice import open_device
    from furcl.distributed import worker

    worker._process.__init__()
    worker.open_device = lambda spec: replace(open_device(spec), driver_version="another driver")


def _with_its_own_driver() -> None:
    from furcl.device.choice import open_device
    from furcl.distributed import worker

    worker._process.__init__()
    worker.open_device = open_device


@pytest.mark.slow
def test_workers_with_other_kernels_are_refused(cluster, device, cache, tmp_path):
    cluster.wait_for_workers(2, timeout=60)
    *_, other = workers_of(cluster)
    cluster.run(_with_other_kernels, workers=[other])
    try:
        with pytest.raises(BenchError, match=r"worker tcp://.*: its kernels of .* differ .* same"):
            convergence.run(_plan(), tmp_path, device=spec_of(device), client=cluster)
    finally:
        cluster.run(_with_its_own_kernels, workers=[other])


def _with_other_kernels() -> None:
    from furcl.bench import convergence_renderers

    convergence_renderers.digest = lambda *parts: "another"


def _with_its_own_kernels() -> None:
    from furcl.bench import convergence_renderers
    from furcl.scene.digest import digest

    convergence_renderers.digest = digest


@pytest.mark.slow
def test_a_folder_of_another_device_is_refused(cluster, alone, device, cache, tmp_path):
    state = json.loads((alone[0] / "renders.json").read_text())
    for record in state["renders"].values():
        record["key"] = "of another device"
    before = json.dumps(state)
    (tmp_path / "renders.json").write_text(before)
    with pytest.raises(BenchError, match="holds renders of patch by uniform-h with another"):
        convergence.run(_plan(), tmp_path, device=spec_of(device), client=cluster)
    assert (tmp_path / "renders.json").read_text() == before


@pytest.mark.slow
def test_workers_are_sent_samplers_of_a_users_own(cluster, device, cache, tmp_path):
    """With what their files include from beside them; the same pictures as by one device."""
    folder = tmp_path / "own"
    (folder / "deeper").mkdir(parents=True)
    header = kernel_folder() / "include" / samplers.find("attenuation-cdf").header
    (folder / "deeper" / "part.clh").write_text(header.read_text())
    (folder / "mine.clh").write_text(
        '/* joint_densities and sample_lobe_and_offset */\n#include "deeper/part.clh"\n'
    )
    plan, found = None, []
    samplers.register("mine", folder / "mine.clh", needs_tables=True)
    try:
        plan = _plan(sampling=("uniform-h", "mine"), runs=2)
        for client in (cluster, None):
            chosen = device if client is None else spec_of(device)
            out = tmp_path / str(len(found))
            found.append(convergence.run(plan, out, device=chosen, client=client))
    finally:
        samplers.unregister("mine")
    assert _without_times(found[0]["renders"]) == _without_times(found[1]["renders"])
    assert {row["variant"] for row in found[0]["renders"]} == {"uniform-h", "mine"}


def test_samplers_outside_their_folder_are_not_sent(tmp_path):
    from furcl.distributed.own_samplers import OwnSampler

    (tmp_path / "own").mkdir()
    (tmp_path / "part.clh").write_text("")
    header = tmp_path / "own" / "mine.clh"
    header.write_text('/* joint_densities, sample_lobe_and_offset */\n#include "../part.clh"\n')
    samplers.register("mine", header)
    try:
        (tmp_path / "part.clh").write_text("/* there */")
        with pytest.raises(SamplerError, match=r"'mine': .*part\.clh is not below .*own"):
            OwnSampler.of("mine")
        header.unlink()
        with pytest.raises(SamplerError, match=r"'mine': .*mine\.clh cannot be read"):
            OwnSampler.of("mine")
    finally:
        samplers.unregister("mine")


@pytest.mark.slow
def test_workers_that_share_a_processor_are_told_of(cluster, device, cache, tmp_path, caplog):
    convergence.run(_plan(), tmp_path, device=spec_of(device), client=cluster, progress=StopAt(0))
    assert ("share the processor of" in caplog.text) == device.is_cpu


# Tasks ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_an_end_takes_back_what_is_not_done(cluster, device):
    """By an error, as by Ctrl-C, by the end that `idle` asks for, and by leaving the loop."""
    cluster.wait_for_workers(2, timeout=60)
    workers = Workers(cluster, spec_of(device), one_kind=True)
    asked: list[bool] = []

    def idle() -> bool:
        asked.append(True)
        return len(asked) > 20

    shared = Shared(workers, 0.2)
    assert len(list(shared.results(_slept, range(200), str, idle=idle))) < 200
    assert len(asked) == 21
    with pytest.raises(KeyboardInterrupt):
        _interrupted(shared)
    deadline = time.monotonic() + 30.0
    while any(cluster.processing().values()) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(cluster.processing().values())


@pytest.mark.slow
def test_a_task_that_ends_its_workers_is_named(cluster, device, monkeypatch):
    cluster.wait_for_workers(2, timeout=60)
    monkeypatch.setattr(tasks, "LOSSES", 0)
    shared = Shared(Workers(cluster, spec_of(device), one_kind=False), None)
    with pytest.raises(DeviceError, match=r"number 3: lost 1 times with all workers"):
        list(shared.results(_ended, [3], lambda number: f"number {number}"))
    cluster.wait_for_workers(2, timeout=60)


def _interrupted(shared: Shared[float]) -> None:
    with closing(shared.results(_slept, range(200), str)) as coming:
        for _ in coming:
            raise KeyboardInterrupt


def _slept(device: Device, seconds: float, item: int) -> int:
    time.sleep(seconds)
    return item


def _ended(device: Device, thing: None, item: int) -> None:
    os._exit(1)


# What is refused --------------------------------------------------------------------------------


@pytest.mark.parametrize("bench", ["convergence", "stability"])
@pytest.mark.parametrize(
    ("client", "said"),
    [
        (3, r"client = 3: expected a distributed\.Client, or the address"),
        ("nowhere://x", r"--dask nowhere://x: no scheduler answers there"),
    ],
)
def test_what_is_no_cluster_is_refused(bench, client, said, tmp_path):
    pytest.importorskip("distributed")
    with pytest.raises(DeviceError, match=said):
        _run(bench, tmp_path, client=client)


@pytest.mark.parametrize("bench", ["convergence", "stability"])
def test_a_device_that_is_opened_here_is_of_no_worker(bench, device, tmp_path):
    with pytest.raises(DeviceError, match="opened here: workers open their own"):
        _run(bench, tmp_path, client="tcp://127.0.0.1:1", device=device)


@pytest.mark.parametrize("bench", ["convergence", "stability"])
def test_without_the_package_the_command_says_what_to_install(bench, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    scene = ["single_fibre"] if bench == "convergence" else []
    words = ["bench", bench, *scene, "--quick", "-o", tmp_path / "out", "--dask", "tcp://x:1"]
    assert run(*words) == 2
    assert "pip install 'furcl[cluster]'" in capsys.readouterr().err


def test_a_worker_without_the_device_is_named(cluster, tmp_path):
    with pytest.raises(DeviceError, match=r"worker tcp://.*nowhere"):
        _run("stability", tmp_path, client=cluster, device="nowhere")


def _run(bench: str, folder: Path, **options: Any) -> None:
    if bench == "convergence":
        convergence.run(_plan(), folder, **options)
    else:
        stability.run(folder, quick=True, n_points=2000, renders=False, **options)
