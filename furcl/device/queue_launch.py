"""Launches of the stages that work on queues of paths: kernels/include/core/queue.clh."""

from __future__ import annotations

from furcl.device import launch
from furcl.device.choice import Device

# Paths that a work-item takes, and work-items in a group.
_CPU = (32, 1)
_GPU = (1, 64)


def defines(device: Device) -> dict[str, int]:
    """What the kernels of those stages are built with, for a device."""
    per_item, _ = _CPU if device.is_cpu else _GPU
    return {"FURCL_PATHS_PER_ITEM": per_item, "FURCL_LANES": 16 if per_item % 16 == 0 else 1}


def launch_size(device: Device, n_paths: int) -> tuple[tuple[int], tuple[int]]:
    """Global and local size of a launch over a queue of at most `n_paths` paths."""
    per_item, local = _CPU if device.is_cpu else _GPU
    return launch.grid(n_paths, per_item, local)
