"""What rays cost in counts, which no other work on the machine disturbs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.device import program
from furcl.device.features import Features
from furcl.device.launch import grid, ray_defines
from furcl.rendering.rays import Rays, Tracer


@dataclass(frozen=True, eq=False)
class RayCounts:
    """Of each ray, on its way to the nearest hit.

    Attributes
    ----------
    blocks : (n,) uint32        blocks of the tree that it looks at
    segments : (n,) uint32      segments that it tests exactly
    left : (n,) uint32          segments of its own strand that it begins inside
    """

    blocks: NDArray[np.uint32]
    segments: NDArray[np.uint32]
    left: NDArray[np.uint32]


def count_rays(tracer: Tracer, rays: Rays) -> RayCounts:
    """Trace rays one by one and count.

    Raises
    ------
    KernelBuildError, ResourceError
    """
    device = tracer.device
    features = Features(point_radii=tracer.bvh.point_radii)
    built = program.build(device, "tools/count_rays.cl", features, ray_defines(device))
    with tracer.memory.scratch() as scratch:
        counts = scratch.allocate("ray counts", 16 * rays.n)
        program.kernel_of(built, "count_rays")(
            device.queue,
            *grid(rays.n),
            np.uint32(rays.n),
            *rays.inputs,
            counts,
            *tracer.geometry,
        )
        found = scratch.read(counts, (rays.n, 4), np.uint32)
    return RayCounts(found[:, 0].copy(), found[:, 1].copy(), found[:, 2].copy())
