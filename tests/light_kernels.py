"""The functions of a light's header on arrays, for comparison with its host twin."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pyopencl as cl
from kernel_harness import built
from numpy.typing import NDArray

from furcl.device import layout
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.device.source import expand
from furcl.light.model import Light

LOOKUP = """
__kernel void lookup(__global const float* light, __global const float* points,
                     __global const float* directions, __global float* radiance,
                     __global float* pdf)
{
    const uint i = get_global_id(0);
    const float3 direction = vload3(i, directions);
    vstore3(light_radiance(light, direction), i, radiance);
#if FURCL_LIGHT_SAMPLING
    pdf[i] = light_density(light, vload3(i, points), direction);
#endif
}
"""
SAMPLE = """
__kernel void sample(__global const float* light, __global const float* points,
                     __global const float2* u, __global float* directions,
                     __global float* distances, __global float* radiance, __global float* pdf)
{
    const uint i = get_global_id(0);
    const LightSample sample = light_sample(light, vload3(i, points), u[i]);
    vstore3(sample.direction, i, directions);
    distances[i] = sample.distance;
    vstore3(sample.radiance, i, radiance);
    pdf[i] = sample.pdf;
}
"""


class Lookup(NamedTuple):
    """Radiance (n, 3) and, where the light is sampled, density (n,) of directions."""

    radiance: NDArray[np.float32]
    pdf: NDArray[np.float32]


class Samples(NamedTuple):
    """As furcl.light.sample.LightSamples, in float32."""

    directions: NDArray[np.float32]
    distances: NDArray[np.float32]
    radiance: NDArray[np.float32]
    pdf: NDArray[np.float32]


def _run(device: Device, light: Light, kernel: str, inputs, widths, light_sampling: bool):
    """Outputs (n, width) or (n,) of a kernel of this file over points and rows of values."""
    part = light.part()
    features = Features(light=part, light_sampling=light_sampling)
    text = expand(str(part.header), features) + LOOKUP + (SAMPLE if light_sampling else "")
    text = layout.declarations(text, features) + text
    n = len(inputs[-1])
    points = np.broadcast_to(inputs[0], (n, 3))
    arrays = [
        light.device_buffer(light_sampling),
        *(np.ascontiguousarray(array, np.float32) for array in (points, inputs[1])),
    ]
    return launch(device, text, kernel, arrays, n, widths)


def launch(device: Device, text: str, kernel: str, arrays, n: int, widths):
    """Outputs (n, width) or (n,) of a kernel over n items, which reads arrays in front of them."""
    program = built(device, text)
    flags = cl.mem_flags
    buffers = [
        cl.Buffer(device.context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=array)
        for array in arrays
    ]
    outputs = [np.zeros((n, width) if width > 1 else n, np.float32) for width in widths]
    results = [cl.Buffer(device.context, flags.WRITE_ONLY, array.nbytes) for array in outputs]
    # Groups of one, as stages on CPUs have them: Intel's compiler fails to make vectors of some.
    getattr(program, kernel)(device.queue, (n,), (1,), *buffers, *results)
    for array, buffer in zip(outputs, results, strict=True):
        cl.enqueue_copy(device.queue, array, buffer)
    return outputs


def lookup(
    device: Device, light: Light, points, directions, *, light_sampling: bool = True
) -> Lookup:
    """What the device says of directions (n, 3) from points (n, 3) or (3,)."""
    return Lookup(*_run(device, light, "lookup", (points, directions), (3, 1), light_sampling))


def sample(device: Device, light: Light, points, u) -> Samples:
    """What the device samples with numbers (n, 2) at points (n, 3) or (3,)."""
    return Samples(*_run(device, light, "sample", (points, u), (3, 1, 3, 1), True))
