"""Sizes of kernel launches, and the defines that go with them."""

from __future__ import annotations

from furcl.device.choice import Device
from furcl.device.forks import check_process

#: Work-items in a group, unless a kernel asks for another number. One for every launch: CPU
#: runtimes compile a kernel anew for each size.
LOCAL_SIZE = 64

Size = tuple[tuple[int], tuple[int]]

# Stages over queues of paths (kernels/include/core/paths.clh): paths that a work-item takes,
# work-items in a group.
_PATHS_CPU = (32, 1)
_PATHS_GPU = (1, 64)

# Stages over rays (kernels/include/bvh/traversal.clh): rays that a work-item takes, those of them
# under way at a time, work-items in a group. docs/performance.md tells what other numbers give.
_RAYS_CPU = (128, 32, 1)
_RAYS_GPU = (1, 1, 64)


def grid(n: int, per_item: int = 1, local: int = LOCAL_SIZE) -> Size:
    """Global and local size of a launch over `n` things, of which a work-item takes `per_item`.

    Groups are whole, and there is at least one: kernels leave out what is beyond `n`.

    Raises
    ------
    DeviceError     in a process that was forked after OpenCL was used
    """
    check_process()
    groups = -(-n // (per_item * local))
    return (max(groups, 1) * local,), (local,)


def fibre_grid(device: Device, n: int) -> Size:
    """Global and local size of a launch over `n` things of a kernel that evaluates a fibre.

    On CPUs groups are of one, as those of the stages: Intel's compiler makes vectors of larger
    ones and gets some kernels wrong (2026.22; tests/test_near_field.py and test_simulated.py see
    it).
    """
    return grid(n, local=1 if device.is_cpu else LOCAL_SIZE)


def path_defines(device: Device) -> dict[str, int]:
    """What the stages over queues of paths are built with, for a device."""
    per_item, _ = _PATHS_CPU if device.is_cpu else _PATHS_GPU
    return {"FURCL_PATHS_PER_ITEM": per_item, "FURCL_LANES": 16 if per_item % 16 == 0 else 1}


def path_grid(device: Device, n_paths: int) -> Size:
    """Global and local size of a launch over a queue of at most `n_paths` paths."""
    per_item, local = _PATHS_CPU if device.is_cpu else _PATHS_GPU
    return grid(n_paths, per_item, local)


def ray_defines(device: Device) -> dict[str, int]:
    """What the stages over rays are built with, for a device."""
    per_item, in_flight, _ = _RAYS_CPU if device.is_cpu else _RAYS_GPU
    return {"FURCL_RAYS_PER_ITEM": per_item, "FURCL_RAYS_IN_FLIGHT": in_flight}


def ray_grid(device: Device, n_rays: int) -> Size:
    """Global and local size of a launch over `n_rays` rays."""
    per_item, _, local = _RAYS_CPU if device.is_cpu else _RAYS_GPU
    return grid(n_rays, per_item, local)
