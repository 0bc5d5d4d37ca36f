"""The size of waves: asked for, a constant of the device's class, or what memory allows."""

from types import SimpleNamespace
from typing import Any

import pytest
from scene_documents import fur_patch

from furcl.device import layout
from furcl.device.features import Features
from furcl.errors import ResourceError
from furcl.rendering.renderer import render
from furcl.rendering.wave_size import DEFAULT_CPU, DEFAULT_GPU, WaveSize, choose_wave_size

N_PLANES = len(layout.planes(Features()))
PLENTY = 1 << 50


def _device(*, is_cpu: bool = True, memory: int = PLENTY, allocation: int = PLENTY) -> Any:
    """A device of which only its class and its sizes [bytes] are asked."""
    return SimpleNamespace(
        is_cpu=is_cpu,
        cl_device=SimpleNamespace(global_mem_size=memory),
        max_allocation_bytes=allocation,
    )


@pytest.mark.parametrize(("is_cpu", "default"), [(True, DEFAULT_CPU), (False, DEFAULT_GPU)])
def test_the_default_is_that_of_the_devices_class(is_cpu, default):
    assert choose_wave_size(_device(is_cpu=is_cpu), Features()) == WaveSize(default, "default")


@pytest.mark.parametrize("is_cpu", [True, False])
@pytest.mark.parametrize(("fits", "expected"), [(1, 1), (999, 512), (1024, 1024), (1.5, 1)])
def test_memory_limits_the_size(is_cpu, fits, expected):
    """A quarter of the memory holds the state and five queues; one buffer holds the state."""
    for sizes in (
        {"memory": int(4 * fits * 4 * (N_PLANES + 5))},
        {"allocation": int(fits * 4 * N_PLANES)},
    ):
        small = _device(is_cpu=is_cpu, **sizes)
        assert choose_wave_size(small, Features()) == WaveSize(expected, "memory")
        assert choose_wave_size(small, Features(), asked=777) == WaveSize(777, "asked for")


def test_what_just_fits_is_the_default():
    slot = 4 * 4 * (N_PLANES + 5)
    assert choose_wave_size(_device(memory=DEFAULT_CPU * slot), Features()).origin == "default"
    assert choose_wave_size(_device(memory=(DEFAULT_CPU - 1) * slot), Features()).origin == "memory"


@pytest.mark.parametrize("asked", [0, -1])
def test_no_wave_is_refused(asked):
    with pytest.raises(ResourceError, match=f"wave size {asked}: at least one path"):
        choose_wave_size(_device(), Features(), asked)


def test_statistics_tell_the_size_and_why(device):
    asked, default = (
        render(fur_patch(), device=device, wave_size=size).stats for size in (70, None)
    )
    assert (asked["wave_size"], asked["wave_size_from"]) == (70, "asked for")
    assert default["wave_size"] == (DEFAULT_CPU if device.is_cpu else DEFAULT_GPU)
    assert default["wave_size_from"] == "default"
