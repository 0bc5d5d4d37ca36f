"""Run single device functions on arrays: a kernel made of an include and one expression."""

from __future__ import annotations

import numpy as np
import pyopencl as cl

from furcl.device import layout
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.device.launch import grid
from furcl.device.memory import Memory
from furcl.device.pocl_library import for_compiler
from furcl.device.program import OPTIONS
from furcl.device.source import expand
from furcl.fibre.double_cylinder.features import DoubleCylinderFeatures

#: Features with every part of the double cylinder.
FULL = Features(fibre=DoubleCylinderFeatures())


def built(device: Device, text: str) -> cl.Program:
    """A program of a whole text, as furcl builds it."""
    return cl.Program(device.context, for_compiler(device, text)).build(list(OPTIONS))


def call(
    device: Device,
    include: str,
    expression: str,
    *arguments,
    features: Features | None = None,
    before: str = "",
    lanes: int = 1,
) -> np.ndarray:
    """Evaluate an OpenCL expression of x, y, z, ... (float32 arrays of one shape) elementwise.

    `before` is OpenCL text between the include and the kernel; `lanes` is FURCL_LANES, and as many
    paths are a work-item's.

    Returns (n,) float32.
    """
    names = "xyzabc"[: len(arguments)]
    arrays = np.broadcast_arrays(*[np.asarray(a, np.float32) for a in arguments])
    parameters = ", ".join(f"__global const float* p{name}" for name in names)
    reads = " ".join(f"const float {name} = p{name}[i];" for name in names)
    chosen = features or FULL
    text = expand(include, chosen) + (
        f"\n{before}\n__kernel void call(const uint n, __global float* out, {parameters})\n"
        f"{{ const uint i = get_global_id(0); if (i >= n) return; {reads} out[i] = {expression}; }}"
    )
    launch = {"FURCL_LANES": lanes, "FURCL_PATHS_PER_ITEM": lanes}
    text = layout.declarations(text, chosen, launch) + text
    program = built(device, text)
    memory = Memory(device)
    n = arrays[0].size
    out = memory.allocate("out", 4 * n)
    buffers = [
        memory.upload(name, array.ravel()) for name, array in zip(names, arrays, strict=True)
    ]
    cl.Kernel(program, "call")(device.queue, *grid(n), np.uint32(n), out, *buffers)
    return memory.read(out, n)
