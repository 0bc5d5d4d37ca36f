"""Plain arrays of rays through the trees of a groom and of meshes, for benchmarks and tests."""

from __future__ import annotations

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.bvh.build import build_bvh
from furcl.device import program
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.device.launch import ray_defines, ray_grid
from furcl.device.layout import NO_SEGMENT
from furcl.device.memory import Memory
from furcl.groom.curves import Curves
from furcl.surface.mesh.mesh import MeshPart


class Rays:
    """Rays that stay on the device while they are traced, once or many times.

    Parameters
    ----------
    origins : (n, 3) float32
    directions : (n, 3) float32         unit length
    t_max : (n,) float32 or scalar      largest distance of a hit
    from_segment : (n,) uint32 or None  segment on whose axis the ray begins (its first vertex), or
                                        NO_SEGMENT: the ray does not hit the fibre that it leaves;
                                        beside meshes a triangle too, TRIANGLE + its first vertex
    times : (n,) float32 or scalar      when each ray sees a groom that moves, in its time steps,
                                        0 to the last one
    """

    def __init__(
        self,
        memory: Memory,
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        t_max: NDArray[np.float32] | float = np.inf,
        from_segment: NDArray[np.uint32] | None = None,
        times: NDArray[np.float32] | float = 0.0,
    ) -> None:
        self.n = len(origins)
        packed = np.empty((2, self.n, 4), np.float32)
        packed[0, :, :3], packed[0, :, 3] = origins, times
        packed[1, :, :3], packed[1, :, 3] = directions, t_max
        segment = np.full(self.n, NO_SEGMENT) if from_segment is None else from_segment
        self.inputs = [
            memory.upload("ray origins", packed[0]),
            memory.upload("ray directions", packed[1]),
            memory.upload("ray segments", np.asarray(segment, np.uint32)),
        ]
        names = ("hit t", "hit segment", "hit u")
        self.outputs = [memory.allocate(name, 4 * self.n) for name in names]


class Tracer:
    """Trees on a device, and the kernels that send plain arrays of rays through them.

    Parameters
    ----------
    point_radii : bool      False where all points have one radius; then it is stored once
    corners : (n, 3, 3) float32 or None     triangles beside the groom

    Attributes
    ----------
    bvh : Bvh               the tree, built here

    Raises
    ------
    KernelBuildError    if the kernels do not compile
    BvhError            as build_bvh
    ResourceError       if the tree does not fit the device
    """

    def __init__(
        self,
        device: Device,
        curves: Curves,
        point_radii: bool = True,
        corners: NDArray[np.float32] | None = None,
    ) -> None:
        self.device = device
        self.memory = Memory(device)
        self.bvh = build_bvh(self.memory, curves, point_radii, corners)
        self.geometry = self.bvh.arguments()
        features = Features(
            point_radii=self.bvh.point_radii,
            motion=self.bvh.motion,
            meshes=None if corners is None else MeshPart(normals=False),
        )
        built = program.build(device, "tools/trace_rays.cl", features, ray_defines(device))
        self._closest = program.kernel_of(built, "trace_rays")
        self._shadow = program.kernel_of(built, "trace_shadow_rays")

    def closest(self, rays: Rays) -> cl.Event:
        """Start the search for nearest hits; `hits` reads them."""
        return self._closest(
            self.device.queue,
            *ray_grid(self.device, rays.n),
            np.uint32(rays.n),
            *rays.inputs,
            *rays.outputs,
            *self.geometry,
        )

    def shadow(self, rays: Rays) -> cl.Event:
        """Start the search for any hits; `occluded` reads them."""
        return self._shadow(
            self.device.queue,
            *ray_grid(self.device, rays.n),
            np.uint32(rays.n),
            *rays.inputs,
            *rays.outputs[:2],
            *self.geometry,
        )

    def hits(self, rays: Rays) -> tuple[NDArray, NDArray, NDArray]:
        """What `closest` found: t (n,) float32, segment (n,) uint32, u (n,) float32.

        segment is the segment's first vertex, of triangles TRIANGLE + that; of a miss NO_SEGMENT,
        and t is the ray's t_max.
        """
        t, segment, u = rays.outputs
        read = self.memory.read
        return read(t, rays.n), read(segment, rays.n, np.uint32), read(u, rays.n)

    def occluded(self, rays: Rays) -> NDArray[np.bool_]:
        """What `shadow` found, (n,)."""
        return self.memory.read(rays.outputs[1], rays.n, np.uint32).astype(bool)
