"""The tree over the triangles of meshes: blocks of boxes (kernels/include/bvh/block.clh)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.bvh.build import BLOCK_BYTES, upload_vertices
from furcl.bvh.chunk import ChunkBuilder
from furcl.device import index_checks
from furcl.device.layout import BVH_STACK_SIZE
from furcl.device.memory import Memory
from furcl.errors import BvhError

#: The buffers that `build_triangle_bvh` leaves in the memory that it is given.
BUFFERS = ("mesh bvh", "mesh vertices", "mesh ends")


@dataclass(frozen=True, eq=False)
class TriangleBvh:
    """A tree of 8-wide blocks over triangles, on a device.

    Attributes
    ----------
    blocks : cl.Buffer      as furcl.bvh.build.Bvh; references are numbers of first vertices
    vertices : cl.Buffer    three a triangle, stored as those of a groom with or without radii
    ends : cl.Buffer        0: no words say where strands end
    n_blocks, n_triangles : int
    stack_size : int        stack entries that a traversal can need
    build_seconds : float   time that the build took, upload included [s]
    """

    blocks: cl.Buffer
    vertices: cl.Buffer
    ends: cl.Buffer
    n_blocks: int
    n_triangles: int
    stack_size: int
    build_seconds: float

    def arguments(self) -> list[cl.Buffer]:
        """What kernels take as mesh_blocks, mesh_vertices and mesh_ends, in that order."""
        return [self.blocks, self.vertices, self.ends]


def build_triangle_bvh(
    memory: Memory, corners: NDArray[np.float32], point_radii: bool = True, *, debug: bool = False
) -> TriangleBvh:
    """Build the tree over triangles; what is uploaded or made stays in `memory`.

    Parameters
    ----------
    memory : Memory             takes BUFFERS
    corners : (n, 3, 3) float32     n > 0, finite
    point_radii : bool          how the vertices of the kernels are stored (Features.point_radii)
    debug : bool                room for what debug builds need, as furcl.bvh.build.build_bvh

    Raises
    ------
    BvhError    if Embree cannot be used, or if the tree is too deep for the traversal stack
    ResourceError, KernelBuildError
    """
    start = time.perf_counter()
    n = len(corners)
    points = corners.reshape(-1, 3)
    vertices = upload_vertices(
        memory, "mesh vertices", points, np.zeros(len(points), np.float32), point_radii
    )
    size = float(np.ptp(points, axis=0).max())
    spare_bytes = BLOCK_BYTES + index_checks.RECORD_BYTES if debug else 0
    with memory.scratch() as scratch:
        builder = ChunkBuilder(scratch, vertices, point_radii, size, capacity=n, triangles=True)
        root = builder.plan(np.arange(0, 3 * n, 3, dtype=np.uint32))
        if root.stack_size > BVH_STACK_SIZE:
            raise BvhError(
                f"the tree of {n} triangles needs a stack of {root.stack_size} entries, kernels "
                f"have {BVH_STACK_SIZE}; the mesh is extremely uneven: split or remesh it"
            )
        blocks = memory.allocate("mesh bvh", BLOCK_BYTES * root.n_blocks + spare_bytes, zero=debug)
        builder.write(blocks, first_block=0)
        memory.device.queue.finish()
    return TriangleBvh(
        blocks=blocks,
        vertices=vertices,
        ends=index_checks.upload(memory, "mesh ends", np.zeros(1, np.uint32), debug),
        n_blocks=root.n_blocks,
        n_triangles=n,
        stack_size=root.stack_size,
        build_seconds=time.perf_counter() - start,
    )
