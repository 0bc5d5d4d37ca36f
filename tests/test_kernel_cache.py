"""The cache of built kernels: what its key covers, and what happens to bad entries."""

import dataclasses

import numpy as np
import pyopencl as cl
import pytest

from furcl.device import kernel_cache, program, source
from furcl.device.features import Features
from furcl.device.launch import path_defines, ray_defines
from furcl.device.memory import Memory
from furcl.device.source import kernel_text
from furcl.errors import KernelBuildError

TEXT = "__kernel void constant_value(__global float* out) { out[0] = VALUE; }\n"
OPTIONS = program.OPTIONS


@pytest.fixture
def cached_device(device, tmp_path, monkeypatch):
    """The device with an empty cache that is used whatever the runtime."""
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernel_cache, "OWN_CACHE_PLATFORMS", ("no platform",))
    return device


def _text(value):
    return TEXT.replace("VALUE", value)


def _value(device, built):
    memory = Memory(device)
    out = memory.allocate("out", 16)
    cl.Kernel(built, "constant_value")(device.queue, (1,), (1,), out)
    return float(memory.read(out, 1)[0])


def _build(device, value):
    return program._build(device, "constant.cl", _text(value), Features())


def test_second_process_reads_what_the_first_stored(cached_device, tmp_path):
    assert _value(cached_device, _build(cached_device, "1.5f")) == 1.5
    (entry,) = (tmp_path / "kernels").iterdir()
    before = entry.stat().st_mtime_ns
    assert _value(cached_device, _build(cached_device, "1.5f")) == 1.5
    (entry,) = (tmp_path / "kernels").iterdir()
    assert entry.stat().st_mtime_ns == before, "the entry was written again"
    assert _value(cached_device, _build(cached_device, "2.5f")) == 2.5
    assert len(list((tmp_path / "kernels").iterdir())) == 2


def test_the_compilers_words_are_kept(cached_device):
    with pytest.raises(KernelBuildError, match="no_such_value"):
        _build(cached_device, "no_such_value")


@pytest.mark.parametrize("damage", [b"", b"no kernel", None])
def test_damaged_entries_are_built_again(cached_device, tmp_path, damage):
    _build(cached_device, "3.5f")
    (entry,) = (tmp_path / "kernels").iterdir()
    entry.write_bytes(entry.read_bytes()[:100] if damage is None else damage)
    assert _value(cached_device, _build(cached_device, "3.5f")) == 3.5
    assert len(entry.read_bytes()) > 100


def test_unwritable_folder_is_no_error(cached_device, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FURCL_CACHE_DIR", str(tmp_path / "file"))
    assert _value(cached_device, _build(cached_device, "4.5f")) == 4.5


def _film(**changes):
    """The text of a stage."""
    return kernel_text("stages/film.cl", Features(**changes), {"FURCL_PATHS_PER_ITEM": 1})


def _keys(device):
    text = _film()
    return kernel_cache.cache_key(device, text, OPTIONS)


@pytest.mark.parametrize(
    "change",
    ["features", "include", "device", "driver", "platform", "options", "nothing"],
)
def test_key_covers_all_that_decides_a_binary(device, tmp_path, monkeypatch, change):
    before = _keys(device)
    text, options, other = _film(), OPTIONS, device
    if change == "features":
        text = _film(variance=False)
    elif change == "include":
        import shutil

        folder = tmp_path / "kernels"
        shutil.copytree(source.kernel_folder(), folder)
        spectrum = folder / "include" / "core/spectrum.clh"
        spectrum.write_text(spectrum.read_text() + "/* one more comment */\n")
        monkeypatch.setattr(source, "kernel_folder", lambda: folder)
        text = _film()
    elif change == "options":
        options = (*OPTIONS, "-cl-mad-enable")
    elif change != "nothing":
        field = {"device": "name", "driver": "driver_version", "platform": "platform"}[change]
        other = dataclasses.replace(device, **{field: "another"})
    after = kernel_cache.cache_key(other, text, options)
    assert (after == before) == (change == "nothing")


@pytest.mark.parametrize(
    ("file", "change", "rebuilt"),
    [
        ("stages/film.cl", {"variance": False}, True),
        ("stages/film.cl", {"roulette": False}, False),
        ("stages/intersect.cl", {"filter": "box"}, False),
        ("stages/intersect.cl", {"channels": 1}, True),
        ("stages/generate.cl", {"filter": "box"}, True),
        ("prepare/bvh_build.cl", {"channels": 1}, False),
        ("prepare/bvh_build.cl", {"point_radii": False}, True),
    ],
)
def test_only_what_a_kernel_names_rebuilds_it(device, file, change, rebuilt):
    extra = {**path_defines(device), **ray_defines(device), "FURCL_TRIANGLES": 0}
    keys = [
        kernel_cache.cache_key(device, kernel_text(file, features, extra), OPTIONS)
        for features in (Features(), Features(**change))
    ]
    assert (keys[0] != keys[1]) == rebuilt


def test_bits_are_those_of_a_fresh_build(cached_device):
    values = np.array(
        [_value(cached_device, _build(cached_device, "0.1f / 3.0f")) for _ in range(2)]
    )
    assert values[0] == values[1]
