"""How many paths are traced together."""

from __future__ import annotations

from dataclasses import dataclass

from furcl.device import layout
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.errors import ResourceError
from furcl.rendering.learning import RECORDS
from furcl.values import is_whole, shown

# Larger waves leave CPUs idle for less of the time, a few percent from 2^15 on; but PoCL compiles
# kernels again for grids of 2^16 work-items, and grids are whole groups of 64. A GPU needs enough
# paths to fill it: an H200 is 1.4 to 1.6 times as fast with 2^22 as with 2^20. docs/notebook.md has
# both measurements.
DEFAULT_CPU = (1 << 16) - 64
DEFAULT_GPU = 1 << 22

# Slots are counted in 32 bits, with room for a grid's last work-group.
LARGEST = 1 << 30

# Path state and queues may take this share of the device's memory.
MEMORY_SHARE = 0.25


@dataclass(frozen=True)
class WaveSize:
    """The most paths of a wave, and why.

    Attributes
    ----------
    paths : int         >= 1
    origin : str        "asked for", "default", or "memory" where the default does not fit
    """

    paths: int
    origin: str


def choose_wave_size(device: Device, features: Features, asked: int | None = None) -> WaveSize:
    """The size asked for, else the default of CPUs or GPUs, else the power of two that fits.

    Pictures do not depend on it.

    Raises
    ------
    ResourceError       if `asked` is no whole number of 1 to LARGEST
    """
    if asked is not None:
        if not is_whole(asked) or not 1 <= asked <= LARGEST:
            raise ResourceError(
                f"wave size {shown(asked)}: at least one path is traced at a time, and at most "
                f"{LARGEST}; give a whole number, or leave it out"
            )
        return WaveSize(int(asked), "asked for")
    default = DEFAULT_CPU if device.is_cpu else DEFAULT_GPU
    most = max(affordable(device, features), 1)
    if default <= most:
        return WaveSize(default, "default")
    return WaveSize(1 << (most.bit_length() - 1), "memory")


def affordable(device: Device, features: Features) -> int:
    """Paths whose state, records and entries in the five queues fit the device's memory."""
    n_planes = len(layout.planes(features))
    n_records = 0 if features.learning is None else RECORDS
    in_memory = MEMORY_SHARE * device.cl_device.global_mem_size / (4 * (n_planes + n_records + 5))
    return int(min(in_memory, device.max_allocation_bytes / (4 * max(n_planes, n_records))))
