"""Renders that several devices or machines share: the same bits, nothing lost with one of them."""

import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clusters import Kill, local_cluster, spec_of, workers_of
from scene_documents import fur_patch

import furcl
from furcl.device.choice import Candidate, Device, list_candidates, open_cl_device
from furcl.device.several import names_several, open_devices, split_names
from furcl.distributed import devices, parts
from furcl.distributed.devices import render_on
from furcl.errors import DeviceError, SceneError
from furcl.image.image import Image
from furcl.rendering.renderer import Renderer
from furcl.scene.read import with_overrides
from furcl.scene.tables import Scene

# By range of samples, with what is learned in each; by seed.
KINDS = {
    "even": {"roulette": "adjoint", "light_sampling": "mis", "sequence": "sobol"},
    "adaptive": {"allocation": "adaptive", "light_sampling": "mis"},
}
PART_SPP = 6


def _scene(**render: Any) -> Scene:
    return with_overrides(fur_patch({"preset": "human-black"}, spp=20, **render), size=(24, 16))


@pytest.fixture(scope="module")
def two(device: Device) -> list[Device]:
    """Two devices, as far as contexts and queues go."""
    return [open_cl_device(device.cl_device) for _ in range(2)]


@pytest.fixture(scope="module")
def alone(device: Device) -> dict[str, Image]:
    """The picture of each kind, by one device that takes one part after the other."""
    found = {}
    for kind, render in KINDS.items():
        scene = with_overrides(_scene(**render), spp=PART_SPP)
        renderer, merging = Renderer(scene, device), parts.Merging()
        for part in parts.parts_of(_scene(**render), PART_SPP):
            merging.add(part, parts.render_part(renderer, part))
        image = merging.image()
        assert image is not None
        found[kind] = image
    return found


def _bits(image: Image) -> bytes:
    assert image.variance is not None
    assert image.samples is not None
    return image.rgb.tobytes() + image.variance.tobytes() + image.samples.tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_devices_share_a_render_to_the_same_bits(kind, two, alone):
    seen = []
    image = render_on(
        _scene(**KINDS[kind]), two, part_spp=PART_SPP, progress=lambda *n: seen.append(n)
    )
    assert _bits(image) == _bits(alone[kind])
    assert image.stats["complete"]
    assert len(image.stats["parts"]) == 4
    assert image.stats["paths"] == 20 * 24 * 16
    assert {total for _, total in seen} == {20 * 24 * 16}
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_the_picture_is_that_of_the_scene(alone, device):
    """Parts of the even kind are the samples of a whole render but for what is learned; the others
    have seeds of their own: both within the errors of both."""
    for kind, render in KINDS.items():
        whole, found = furcl.render(_scene(**render), device=device), alone[kind]
        assert whole.variance is not None
        assert found.variance is not None
        error = np.sqrt(float((whole.variance + found.variance).sum(dtype=np.float64)))
        # Of the sum over all pixels, an upper bound with Sobol numbers: alpha 1e-3, two of them.
        assert abs(float((found.rgb - whole.rgb).sum(dtype=np.float64))) < 3.5 * error


@pytest.mark.parametrize(
    ("spp", "part_spp", "expected"),
    [(20, 6, [6, 6, 6, 2]), (5, None, [5]), (40, None, [16, 16, 8]), (25600, None, [100] * 256)],
)
def test_parts_are_all_samples_once(spp, part_spp, expected):
    found = parts.parts_of(_scene_of(spp, "even"), part_spp)
    assert [part.spp for part in found] == expected
    assert [part.first for part in found] == [sum(expected[:i]) for i in range(len(expected))]
    assert {part.seed for part in found} == {0}
    found = parts.parts_of(_scene_of(spp, "adaptive"), part_spp)
    assert [part.spp for part in found] == expected
    assert {part.first for part in found} == {0}
    assert len({part.seed for part in found}) == len(found)
    assert found[0].seed == 0


def _scene_of(spp: int, allocation: str) -> Scene:
    return fur_patch({"preset": "human-black"}, spp=spp, allocation=allocation)


@pytest.mark.parametrize("part_spp", [0, -1, 1.5, "4", True])
def test_what_is_no_number_of_samples_is_refused(part_spp):
    with pytest.raises(SceneError, match="part_spp"):
        parts.parts_of(_scene(), part_spp)


class _Failing:
    """`render_part` that fails on a device after some parts, as a lost device does. Others wait
    until then, or nothing would be left for it."""

    def __init__(self, device: Device, after: int) -> None:
        self.device, self.after, self.failed = device, after, threading.Event()

    def __call__(self, renderer: Renderer, part: parts.Part, progress: Any) -> Image:
        if renderer.device is self.device:
            self.after -= 1
            if self.after < 0:
                self.failed.set()
                raise RuntimeError("device lost")
        else:
            self.failed.wait()
        return parts.render_part(renderer, part, progress)


@pytest.mark.parametrize("after", [0, 1])
def test_a_device_that_fails_costs_its_part_alone(after, two, alone, monkeypatch, caplog):
    monkeypatch.setattr(devices, "render_part", _Failing(two[0], after))
    image = render_on(_scene(**KINDS["even"]), two, part_spp=PART_SPP)
    assert _bits(image) == _bits(alone["even"])
    assert image.stats["complete"]
    assert "is left out: device lost" in caplog.text


def test_where_all_devices_fail_the_first_says_why(two, monkeypatch):
    def fails(*_: Any) -> Image:
        raise RuntimeError("device lost")

    monkeypatch.setattr(devices, "render_part", fails)
    with pytest.raises(RuntimeError, match="device lost"):
        render_on(_scene(), two, part_spp=PART_SPP)


def test_a_device_that_stands_still_does_not_stall_the_end(two, alone, monkeypatch):
    """The first device never gets on with its part; the other takes that too, and sets it free."""
    stalled = threading.Event()

    def render_part(renderer: Renderer, part: parts.Part, progress: Any) -> Image:
        if renderer.device is two[0]:
            stalled.set()
            while not progress(0, 1):
                pass
        else:
            stalled.wait()
        return parts.render_part(renderer, part, progress)

    monkeypatch.setattr(devices, "render_part", render_part)
    image = render_on(_scene(**KINDS["even"]), two, part_spp=PART_SPP)
    assert _bits(image) == _bits(alone["even"])


def test_a_stopped_render_has_the_samples_so_far(two):
    image = render_on(
        _scene(), two, part_spp=PART_SPP, wave_size=200, progress=lambda done, _: done > 1500
    )
    assert not image.stats["complete"]
    assert image.samples is not None
    assert 1500 < image.samples.sum() < 20 * 24 * 16
    assert np.isfinite(image.rgb).all()


def test_several_devices_by_name(device):
    assert [d.name for d in open_devices("all")]
    assert open_devices([device]) == [device]
    index = spec_of(device)
    assert open_devices(index)[0].name == device.name
    with pytest.raises(DeviceError, match="names one device twice"):
        open_devices(f"{index},{index}")
    for nothing in ("", "0,", []):
        with pytest.raises(DeviceError, match="with commas between"):
            open_devices(nothing)


H200 = "NVIDIA H200 (NVIDIA CUDA, driver 580.159.04)"
EPYC = "AMD EPYC (Intel(R) OpenCL, driver 2026.22.10.0.01)"


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (H200, [H200]),
        (f"{H200},{EPYC}", [H200, EPYC]),
        (f"h200, {EPYC}, 1", ["h200", EPYC, "1"]),
        ("CUDA, driver 580", ["CUDA, driver 580"]),
        ("H200,epyc", ["H200", "epyc"]),
        ("0,1", ["0", "1"]),
        ("0:0, 1:0", ["0:0", "1:0"]),
        ("H200,", ["H200", ""]),
        (",,", ["", "", ""]),
    ],
)
def test_commas_of_a_description_divide_no_names(text, names):
    there = []
    for index, description in enumerate((H200, EPYC)):
        found = re.fullmatch(r"(.*?) \((.*), driver (.*)\)", description)
        assert found
        name, runtime, driver = found.groups()
        there.append(
            Candidate(
                index=index, address=f"{index}:0", name=name, runtime=runtime,
                runtime_version="", driver_version=driver, kind="CPU", compute_units=2,
                memory_bytes=2**30,
            )
        )  # fmt: skip
    assert split_names(text, there) == names


def test_a_whole_description_is_one_device(device):
    chosen = list_candidates()[int(spec_of(device))]
    assert "," in chosen.description
    assert not names_several(chosen.description)
    assert names_several(f"{chosen.description}, {chosen.description}")
    assert [d.name for d in open_devices(chosen.description)] == [device.name]


# A cluster


def _lit_by_an_image(folder: Path) -> Scene:
    """A scene that names a file, which is gone when workers need it."""
    light = np.ones((4, 8, 3), np.float32)
    light[1, 3] = 30.0
    Image(light).save(folder / "light.exr")
    scene = _scene(**KINDS["even"])
    environment = f'environment={{kind="image", file="{folder / "light.exr"}"}}'
    return with_overrides(scene, [environment])


def test_a_job_carries_the_files_of_its_scene(tmp_path, device):
    from furcl.distributed.job import Job

    scene = with_overrides(_lit_by_an_image(tmp_path), spp=2)
    job = Job.of(scene, scene.build_grooms())
    whole = furcl.render(scene, device=device)
    (tmp_path / "light.exr").unlink()
    (tmp_path / "worker").mkdir()
    found = furcl.render(job.scene(tmp_path / "worker"), curves=job.grooms, device=device)
    assert _bits(found) == _bits(whole)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with local_cluster() as client:
        yield client


@pytest.mark.slow
def test_a_cluster_gives_the_same_bits_and_a_lost_worker_costs_nothing(
    cluster, alone, tmp_path, device
):
    from furcl.distributed import render

    scene = _scene(**KINDS["even"])
    options = {"part_spp": PART_SPP, "device": spec_of(device)}
    image = render(scene, cluster, **options)
    assert _bits(image) == _bits(alone["even"])
    assert image.stats["complete"]

    kill = Kill(cluster, 1)
    image = render(scene, cluster, progress=kill, **options)
    assert len(kill.killed) == 1
    assert _bits(image) == _bits(alone["even"])

    lit = _lit_by_an_image(tmp_path)
    found = render(lit, cluster, **options)
    np.testing.assert_array_equal(found.samples, 20)
    with pytest.raises(DeviceError, match="nowhere"):
        render(scene, cluster, part_spp=PART_SPP, device="nowhere")


@pytest.mark.slow
def test_a_scene_that_is_lost_with_all_workers_is_sent_again(cluster, alone, device):
    from furcl.distributed import render

    cluster.wait_for_workers(2, timeout=60)
    kill = Kill(cluster, 2)
    options = {"part_spp": PART_SPP, "device": spec_of(device)}
    image = render(_scene(**KINDS["even"]), cluster, progress=kill, **options)
    assert len(kill.killed) == 2
    assert _bits(image) == _bits(alone["even"])


def test_a_cluster_without_workers_is_told():
    distributed = pytest.importorskip("distributed")
    from furcl.distributed import render

    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0") as none,
        distributed.Client(none, timeout=1) as client,
        pytest.raises(DeviceError, match="has no worker"),
    ):
        render(_scene(**KINDS["even"]), client)


@pytest.mark.slow
def test_a_worker_that_stands_still_does_not_stall_the_end(cluster, alone, device):
    """Last in this file: the worker stands still for longer than the test takes."""
    from furcl.distributed import render

    cluster.wait_for_workers(2, timeout=60)  # the one that was killed is started anew
    cluster.run(_stand_still, workers=workers_of(cluster)[:1])
    scene = _scene(**KINDS["even"])
    image = render(scene, cluster, part_spp=PART_SPP, device=spec_of(device))
    assert _bits(image) == _bits(alone["even"])


def _stand_still() -> None:
    """Make the tasks of this process wait."""
    from furcl.distributed import cluster

    def render_part(*_: Any) -> Image:
        time.sleep(600.0)
        raise AssertionError

    cluster.render_part = render_part
