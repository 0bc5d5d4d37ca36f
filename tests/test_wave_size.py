"""The size of waves: measured on a render's own samples, remembered, limited by memory."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scene_documents import fur_patch

import furcl
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.errors import ResourceError
from furcl.render import wave_size
from furcl.render.renderer import Renderer
from furcl.render.wave_size import WaveSize

N_PIXELS = 24 * 16


@pytest.fixture(autouse=True)
def small(monkeypatch, tmp_path):
    """An empty cache, and candidates that a few samples of the patch of fur fill."""
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(wave_size, "CANDIDATES_CPU", (1000, 500, 2000))
    monkeypatch.setattr(wave_size, "CANDIDATES_GPU", (1000, 500, 2000))


def _play(sizes: WaveSize, seconds_per_path: dict[int, float]) -> list[int]:
    """The waves of a probe in which every size has a speed of its own."""
    waves = []
    while sizes.probing:
        waves.append(sizes.limit())
        sizes.record(waves[-1], waves[-1] * seconds_per_path[sizes.paths])
    return waves


def test_every_candidate_traces_the_same_pixels(device):
    sizes = WaveSize(device, Features(), N_PIXELS)
    assert (sizes.paths, sizes.capacity, sizes.origin) == (1000, 2000, "first guess")
    waves = _play(sizes, {1000: 1e-6, 500: 2e-6, 2000: 5e-7})
    # 2304 paths are 6 samples of every pixel; the first wave is not measured.
    assert waves == [1000, *2 * [1000, 1000, 304, 500, 500, 500, 500, 304, 2000, 304]]
    assert (sizes.paths, sizes.origin) == (2000, "probe")


def test_a_moment_of_other_load_does_not_decide(device):
    sizes = WaveSize(device, Features(), N_PIXELS)
    sizes.record(sizes.limit(), 1.0)
    for seconds in (9.0, 4.0, 4.5, 3.0, 4.2, 9.0):
        size = sizes.paths
        while sizes.paths == size and sizes.probing:
            n = sizes.limit()
            sizes.record(n, seconds * n)
    assert sizes.paths == 1000


def test_a_small_gain_changes_nothing(device):
    sizes = WaveSize(device, Features(), N_PIXELS)
    _play(sizes, {1000: 1e-6, 500: 0.99e-6, 2000: 1.1e-6})
    assert sizes.paths == 1000


def test_the_choice_is_remembered_for_device_and_features(device):
    _play(WaveSize(device, Features(), N_PIXELS), {1000: 1e-6, 500: 5e-7, 2000: 1e-6})
    again = WaveSize(device, Features(), 10)
    assert (again.paths, again.capacity, again.origin) == (500, 500, "cache")
    assert not again.probing
    assert WaveSize(device, Features(body=True), N_PIXELS).probing
    newer = Device(device.context, device.queue, device.name, device.platform, "0", device.is_cpu)
    assert WaveSize(newer, Features(), N_PIXELS).probing
    assert WaveSize(device, Features(), N_PIXELS, asked=77).origin == "asked for"


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"paths": "many"}', '{"paths": 123}'])
def test_a_damaged_file_is_measured_again(device, text):
    path = wave_size.cache_path(device, Features())
    path.parent.mkdir(parents=True)
    path.write_text(text)
    sizes = WaveSize(device, Features(), N_PIXELS)
    _play(sizes, {1000: 1e-6, 500: 5e-7, 2000: 1e-6})
    assert json.loads(path.read_text()) == {"paths": 500}


def test_memory_limits_the_size(device):
    slot = wave_size.bytes_per_path(Features())

    def affordable(paths):
        small: Any = SimpleNamespace(
            cl_device=SimpleNamespace(global_mem_size=4 * paths * slot),
            max_allocation_bytes=1 << 40,
            is_cpu=device.is_cpu,
        )
        return wave_size.affordable(small, Features())

    assert affordable(1999) == (1000, 500)
    assert affordable(499) == (256,)


def test_no_wave_is_refused(device):
    with pytest.raises(ResourceError, match="wave size 0: at least one path"):
        WaveSize(device, Features(), N_PIXELS, asked=0)


def test_a_probe_changes_no_bit(device):
    """A render that measures all candidates, one that knows the answer, one that is told."""
    probed, known = (furcl.render(fur_patch(spp=48), device=device) for _ in range(2))
    told = furcl.render(fur_patch(spp=48), device=device, wave_size=700)
    origins = [image.stats["wave_size_from"] for image in (probed, known, told)]
    assert origins == ["probe", "cache", "asked for"]
    assert probed.stats["wave_size"] == known.stats["wave_size"] in (500, 1000, 2000)
    assert told.stats["wave_size"] == 700
    assert np.array_equal(probed.rgb, known.rgb)
    assert np.array_equal(probed.rgb, told.rgb)
    assert probed.stats["rays"] == known.stats["rays"] == told.stats["rays"]


def test_a_probe_goes_on_in_the_next_call(device):
    renderer = Renderer(fur_patch(), device)
    renderer.advance(3)
    assert renderer.stats()["wave_size_from"] == "first guess"
    renderer.settle()
    assert renderer.stats()["wave_size_from"] == "probe"
