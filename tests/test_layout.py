"""What crosses to the device: structs, planes of the path state, buffers."""

import numpy as np
import pytest

from furcl.device import layout
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.errors import LayoutError, ResourceError


@pytest.mark.parametrize("light_sampling", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_planes_follow_the_features(channels, light_sampling):
    names = layout.planes(Features(channels=channels, light_sampling=light_sampling))
    assert len(names) == len(set(names))
    assert ("SHADOW_DIR_X" in names) == light_sampling
    assert sum(name.startswith("THROUGHPUT") for name in names) == channels


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ((("a", "float"), ("b", "float4")), "b: float4 at byte 4; .*put the float4s first"),
        ((("a", "float4"), ("b", "float")), "20 bytes are no multiple of 16; fill it up"),
        ((("a", "double"),), "a: double at byte 0; allowed are float and uint"),
    ],
)
def test_structs_that_a_device_may_pad_are_refused(fields, message):
    with pytest.raises(LayoutError, match=message):
        layout.struct_dtype(fields)


@pytest.mark.parametrize("name", layout.STRUCTS)
def test_structs_need_no_padding(name):
    dtype = layout.struct_dtype(name)
    assert dtype.itemsize == sum(dtype[field].itemsize for field in dtype.names or ())
    assert dtype.itemsize % 16 == 0


@pytest.mark.parametrize(("n_slots", "whole"), [(0, 0), (1, 16), (16, 16), (17, 32)])
def test_slots_come_in_whole_blocks(n_slots, whole):
    assert layout.whole_blocks(n_slots) == whole


def test_too_large_a_buffer_is_refused_by_name(device):
    memory = Memory(device)
    with pytest.raises(ResourceError, match=r"'film' needs \d+ MiB"):
        memory.allocate("film", device.max_allocation_bytes + 1)


def test_memory_counts_bytes(device):
    memory = Memory(device)
    memory.upload("a", np.zeros(5, np.float32))
    memory.allocate("b", 100)
    assert memory.bytes == {"a": 20, "b": 100}
    assert memory.total_bytes == 120
