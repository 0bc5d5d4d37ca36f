"""Choice of the OpenCL device that furcl computes on."""

from __future__ import annotations

import os
from dataclasses import dataclass

import pyopencl as cl

from furcl.errors import DeviceError


@dataclass(frozen=True, eq=False)
class Device:
    """An opened OpenCL device: one context and one profiling command queue.

    Attributes
    ----------
    context, queue : pyopencl.Context, pyopencl.CommandQueue
    name, platform, driver_version : str   as the runtime reports them
    is_cpu : bool                          True for CPU runtimes
    """

    context: cl.Context
    queue: cl.CommandQueue
    name: str
    platform: str
    driver_version: str
    is_cpu: bool

    @property
    def cl_device(self) -> cl.Device:
        """The pyopencl device."""
        return self.context.devices[0]

    @property
    def max_allocation_bytes(self) -> int:
        """The largest single buffer that the runtime allows [bytes]."""
        return int(self.cl_device.max_mem_alloc_size)


def open_cl_device(device: cl.Device) -> Device:
    """Make the context and the queue of one pyopencl device."""
    context = cl.Context([device])
    queue = cl.CommandQueue(context, properties=cl.command_queue_properties.PROFILING_ENABLE)
    return Device(
        context=context,
        queue=queue,
        name=device.name.strip(),
        platform=f"{device.platform.name.strip()} {device.platform.version.strip()}",
        driver_version=device.driver_version.strip(),
        is_cpu=bool(device.type & cl.device_type.CPU),
    )


def open_device(spec: str | None = None) -> Device:
    """Open the device that `spec`, then FURCL_DEVICE, then the first one found names.

    Parameters
    ----------
    spec : str or None      part of a device or platform name

    Raises
    ------
    DeviceError             if no device matches
    """
    wanted = spec or os.environ.get("FURCL_DEVICE", "")
    for platform in cl.get_platforms():
        for device in platform.get_devices():
            if wanted.lower() in f"{platform.name} {platform.version} {device.name}".lower():
                return open_cl_device(device)
    raise DeviceError(f"no OpenCL device matches {wanted!r}; `furcl devices` lists what there is")
