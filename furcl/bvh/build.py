"""The tree over the segments of a groom and the triangles beside it, as
kernels/include/bvh/block.clh reads it."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.bvh.trees import BLOCK_BYTES, TreeBuilder, upload_corners, write_at
from furcl.device import index_checks
from furcl.device.layout import BLOCK_WORDS, BVH_STACK_SIZE
from furcl.device.memory import Memory
from furcl.errors import BvhError
from furcl.groom.curves import Curves

#: Segments that are built at once: bounds the memory that building needs, about 200 bytes each.
CHUNK_SEGMENTS = 1 << 20

#: The buffers that `build_bvh` leaves in the memory that it is given.
BUFFERS = ("bvh", "vertices", "strands", "corners")

_UPLOAD_POINTS = 1 << 18


@dataclass(frozen=True, eq=False)
class BvhArrays:
    """A tree on the host.

    Attributes
    ----------
    blocks : (b, 32) uint32             see kernels/include/bvh/block.clh
    vertices : (n_points, 4) float32    x, y, z, radius; of a groom that moves (n_points, T, 4)
    offsets : (S + 1,) uint32           strand s owns vertices offsets[s] .. offsets[s + 1] - 1
    stack_size : int                    blocks that wait on the stack in a traversal, at most
    """

    blocks: NDArray[np.uint32]
    vertices: NDArray[np.float32]
    offsets: NDArray[np.uint32]
    stack_size: int


@dataclass(frozen=True, eq=False)
class Bvh:
    """A tree of 8-wide blocks and what its leaves refer to, on a device.

    Attributes
    ----------
    memory : Memory         holds the buffers
    blocks : cl.Buffer      (n_blocks, 32) uint32, see kernels/include/bvh/block.clh
    vertices : cl.Buffer    positions and radii, see kernels/include/geometry/curve.clh
    point_radii : bool      whether each vertex has a radius of its own
    strands : cl.Buffer     which vertices end a strand, see `strand_ends`
    corners : cl.Buffer or None     of triangles, see kernels/include/geometry/triangle.clh
    n_blocks, n_points, n_strands, n_segments, n_triangles : int
    motion : int            pieces of time that the groom moves in, each with a tree; 0: it does not
    stack_size : int        blocks that wait on the stack in a traversal, at most
    build_seconds : float   time that the build took, upload of the groom included [s]
    """

    memory: Memory
    blocks: cl.Buffer
    vertices: cl.Buffer
    point_radii: bool
    strands: cl.Buffer
    corners: cl.Buffer | None
    n_blocks: int
    n_points: int
    n_strands: int
    n_segments: int
    n_triangles: int
    motion: int
    stack_size: int
    build_seconds: float

    @property
    def n_bytes(self) -> int:
        """Memory on the device [bytes]."""
        return sum(buffer.size for buffer in self.arguments())

    def arguments(self) -> list[cl.Buffer]:
        """What kernels take as blocks, vertices, strands and, with triangles, corners, in
        that order."""
        corners = [] if self.corners is None else [self.corners]
        return [self.blocks, self.vertices, self.strands, *corners]

    def read(self) -> BvhArrays:
        """Copy everything back to the host."""
        read = self.memory.read
        return BvhArrays(
            blocks=read(self.blocks, (self.n_blocks, BLOCK_WORDS), np.uint32),
            vertices=self._read_vertices(),
            offsets=_offsets(read(self.strands, 1 + -(-self.n_points // 32), np.uint32)),
            stack_size=self.stack_size,
        )

    def _read_vertices(self) -> NDArray[np.float32]:
        stored = self.memory.read(self.vertices, self.vertices.size // 4)
        if self.motion:
            return stored.reshape(-1, self.motion + 1, 4)
        if self.point_radii:
            return stored.reshape(-1, 4)
        points = stored[1:-1].reshape(-1, 3)
        return np.concatenate([points, np.full((len(points), 1), stored[0])], axis=1)


def build_bvh(
    memory: Memory,
    curves: Curves,
    point_radii: bool = True,
    corners: NDArray[np.float32] | None = None,
    *,
    debug: bool = False,
    chunk_segments: int = CHUNK_SEGMENTS,
) -> Bvh:
    """Build the tree of a groom, and of triangles beside it; what is uploaded or made stays in
    `memory`.

    Parameters
    ----------
    memory : Memory             takes BUFFERS
    curves : Curves             one that moves has a tree for each piece of time between its steps
    point_radii : bool          False stores the radius of the first point for all
                                (Features.point_radii); a groom that moves has one a vertex
    corners : (n, 3, 3) float32 or None     of triangles, n > 0, finite; they keep still
    debug : bool                room for what debug builds need: behind the blocks one of no lanes,
                                where indices outside the tree lead, and records of index checks
    chunk_segments : int        larger grooms are built in 8, 64, ... chunks, of at most about that
                                many segments each, under blocks of boxes

    Raises
    ------
    BvhError    if Embree cannot be used, or if the tree is too deep for the traversal stack
    ResourceError, KernelBuildError
    """
    start = time.perf_counter()
    if curves.steps is None:
        vertices = _upload_vertices(memory, curves.points, curves.radii, point_radii)
    else:
        point_radii = True
        vertices = _upload_steps(memory, curves.steps, curves.radii)
    n_chunks = 1
    while n_chunks * chunk_segments < curves.n_segments:
        n_chunks *= 8  # as many as fill the lanes of the blocks above them
    triangles = None if corners is None else (corners, upload_corners(memory, corners))
    builder = TreeBuilder(
        memory,
        curves,
        vertices,
        point_radii,
        triangles,
        n_chunks=n_chunks,
        spare_bytes=BLOCK_BYTES + index_checks.RECORD_BYTES if debug else 0,
    )
    stack_size = builder.build()
    if stack_size > BVH_STACK_SIZE:
        raise BvhError(
            f"the tree of {curves.n_segments} segments and {builder.n_triangles} triangles needs a "
            f"stack of {stack_size} blocks, kernels have {BVH_STACK_SIZE}; one of the two is "
            f"extremely uneven: split the groom, or remesh"
        )
    return Bvh(
        memory=memory,
        blocks=builder.blocks,
        vertices=vertices,
        point_radii=point_radii,
        strands=index_checks.upload(memory, "strands", strand_ends(curves), debug),
        corners=triangles and triangles[1],
        n_blocks=builder.end,
        n_points=curves.n_points,
        n_strands=curves.n_strands,
        n_segments=curves.n_segments,
        n_triangles=builder.n_triangles,
        motion=builder.motion,
        stack_size=stack_size,
        build_seconds=time.perf_counter() - start,
    )


def no_geometry(memory: Memory, meshes: bool) -> list[cl.Buffer]:
    """In place of `Bvh.arguments`, for launches over nothing: kernels need every argument."""
    return [memory.upload("no geometry", np.zeros(4, np.uint32))] * (4 if meshes else 3)


def watch(checks: index_checks.IndexChecks, bvh: Bvh) -> None:
    """Watch the indices of a tree: its record is behind the ends of strands."""
    checks.watch(
        bvh.strands,
        n_vertices=bvh.n_points,
        n_corners=3 * bvh.n_triangles,
        n_blocks=bvh.n_blocks,
    )


def strand_ends(curves: Curves) -> NDArray[np.uint32]:
    """The number of words that follow, and of word v // 32 bit v % 32: vertex v ends a strand."""
    ends = np.zeros(-(-curves.n_points // 32) * 32, dtype=bool)
    ends[curves.offsets[1:] - 1] = True
    words = np.packbits(ends, bitorder="little").view("<u4")
    return np.concatenate([[len(words)], words]).astype(np.uint32)


def _offsets(strands: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """What `strand_ends` says, as the offsets of `Curves`."""
    ends = np.unpackbits(strands[1:].astype("<u4").view(np.uint8), bitorder="little")
    return np.concatenate([[0], np.flatnonzero(ends) + 1]).astype(np.uint32)


def _upload_vertices(
    memory: Memory, points: NDArray[np.float32], radii: NDArray[np.float32], point_radii: bool
) -> cl.Buffer:
    """What kernels/include/geometry/curve.clh reads of points (n, 3) and radii (n,), copied a part
    at a time."""
    n, width = len(points), 4 if point_radii else 3
    head = np.zeros(0 if point_radii else 1, np.float32)
    head[:] = radii[0]
    buffer = memory.allocate("vertices", 4 * (width * n + 2 * len(head)))
    part = np.empty((min(_UPLOAD_POINTS, n), width), np.float32)
    for begin in range(0, n, _UPLOAD_POINTS):
        end = min(begin + _UPLOAD_POINTS, n)
        part[: end - begin, :3] = points[begin:end]
        if point_radii:
            part[: end - begin, 3] = radii[begin:end]
        write_at(memory, buffer, part[: end - begin], head.nbytes + part.itemsize * width * begin)
    if not point_radii:
        write_at(memory, buffer, head, 0)
    return buffer


def _upload_steps(
    memory: Memory, steps: NDArray[np.float32], radii: NDArray[np.float32]
) -> cl.Buffer:
    """The vertices of a groom that moves: those of a vertex at all time steps (T, n, 3) are side by
    side, copied a part at a time."""
    n_steps, n, _ = steps.shape
    buffer = memory.allocate("vertices", 16 * n_steps * n)
    at_once = max(_UPLOAD_POINTS // n_steps, 1)
    for begin in range(0, n, at_once):
        part = slice(begin, min(begin + at_once, n))
        packed = np.empty((part.stop - begin, n_steps, 4), np.float32)
        packed[:, :, :3] = steps[:, part].transpose(1, 0, 2)
        packed[:, :, 3] = radii[part, None]
        write_at(memory, buffer, packed, 16 * n_steps * begin)
    return buffer
