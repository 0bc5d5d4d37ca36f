"""The tree over the segments of a groom: built for a device, read by kernels/include/bvh.clh."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl import index_checks
from furcl.buffers import Memory
from furcl.bvh_check import BvhArrays, check_bvh
from furcl.bvh_chunk import Chunk, ChunkBuilder
from furcl.bvh_partition import split_segments, top_blocks, top_lanes
from furcl.curves import Curves
from furcl.errors import BvhError
from furcl.layout import BVH_BLOCK_WORDS, BVH_STACK_SIZE

#: Segments that are built at once: bounds the memory that building needs, about 300 bytes each.
CHUNK_SEGMENTS = 1 << 20

#: The buffers that `build_bvh` leaves in the memory that it is given.
BUFFERS = ("bvh", "vertices", "strand offsets")

_BLOCK_BYTES = 4 * BVH_BLOCK_WORDS
_UPLOAD_POINTS = 1 << 18


@dataclass(frozen=True, eq=False)
class Bvh:
    """A tree of 8-wide blocks and what its leaves refer to, on a device.

    Attributes
    ----------
    memory : Memory         holds the buffers
    blocks : cl.Buffer      (n_blocks, 32) uint32, see kernels/include/bvh.clh; block 0 is the root
    vertices : cl.Buffer    positions and radii, see kernels/include/vertices.clh
    point_radii : bool      whether each vertex has a radius of its own
    offsets : cl.Buffer     (n_strands + 1,) uint32: strand s owns vertices offsets[s] ..
                            offsets[s + 1] - 1
    n_blocks, n_points, n_strands, n_segments : int
    longest_strand : int    points of the longest strand
    stack_size : int        stack entries that a traversal can need
    build_seconds : float   time that the build took, upload of the groom included [s]
    """

    memory: Memory
    blocks: cl.Buffer
    vertices: cl.Buffer
    point_radii: bool
    offsets: cl.Buffer
    n_blocks: int
    n_points: int
    n_strands: int
    n_segments: int
    longest_strand: int
    stack_size: int
    build_seconds: float

    @property
    def n_bytes(self) -> int:
        """Memory on the device [bytes]."""
        return _BLOCK_BYTES * self.n_blocks + self.vertices.size + 4 * (self.n_strands + 1)

    def arguments(self) -> list[cl.Buffer | np.uint32]:
        """What BVH_PARAMETERS names in kernels/include/traversal.clh, in that order."""
        numbers = np.uint32(self.n_strands), np.uint32(self.longest_strand)
        return [self.blocks, self.vertices, self.offsets, *numbers]

    def read(self) -> BvhArrays:
        """Copy everything back to the host."""
        read = self.memory.read
        return BvhArrays(
            blocks=read(self.blocks, (self.n_blocks, BVH_BLOCK_WORDS), np.uint32),
            vertices=self._read_vertices(),
            offsets=read(self.offsets, self.n_strands + 1, np.uint32),
            stack_size=self.stack_size,
        )

    def _read_vertices(self) -> NDArray[np.float32]:
        stored = self.memory.read(self.vertices, self.vertices.size // 4)
        if self.point_radii:
            return stored.reshape(-1, 4)
        points = stored[1:-1].reshape(-1, 3)
        return np.concatenate([points, np.full((len(points), 1), stored[0])], axis=1)

    def validate(self, curves: Curves) -> None:
        """Check the whole tree against the groom; see furcl.bvh_check.

        Raises
        ------
        BvhError    naming the first thing that is wrong
        """
        check_bvh(self.read(), curves)


def build_bvh(
    memory: Memory,
    curves: Curves,
    point_radii: bool = True,
    *,
    debug: bool = False,
    chunk_segments: int = CHUNK_SEGMENTS,
) -> Bvh:
    """Build the tree of a groom; what is uploaded or made stays in `memory`.

    Parameters
    ----------
    memory : Memory             takes BUFFERS
    curves : Curves
    point_radii : bool          False stores the radius of the first point for all
                                (Features.point_radii)
    debug : bool                room for what debug builds need: behind the blocks one of no lanes,
                                where indices outside the tree lead, and records of index checks
    chunk_segments : int        larger grooms are built in chunks of that many segments or a few
                                less, under some blocks of boxes

    Raises
    ------
    BvhError    if Embree cannot be used, or if the tree is too deep for the traversal stack
    ResourceError, KernelBuildError
    """
    start = time.perf_counter()
    vertices = _upload_vertices(memory, curves, point_radii)
    lo, hi = curves.bounds()
    builder = ChunkBuilder(memory, vertices, point_radii, float((hi - lo).max()))
    spare_bytes = _BLOCK_BYTES + index_checks.RECORD_BYTES if debug else 0
    n_chunks = -(-curves.n_segments // chunk_segments)
    if n_chunks == 1:
        segments = curves.segment_vertices().view(np.uint32)
        tree = builder.build("bvh", segments, 0, spare_bytes)
    else:
        tree = _build_chunks(memory, builder, curves, n_chunks, spare_bytes)
    if tree.stack_size > BVH_STACK_SIZE:
        raise BvhError(
            f"the tree of {curves.n_segments} segments needs a stack of {tree.stack_size} entries, "
            f"kernels have {BVH_STACK_SIZE}; the groom is extremely uneven: split it"
        )
    return Bvh(
        memory=memory,
        blocks=tree.blocks,
        vertices=vertices,
        point_radii=point_radii,
        offsets=index_checks.upload(
            memory, "strand offsets", curves.offsets.astype(np.uint32), debug
        ),
        n_blocks=tree.n_blocks,
        n_points=curves.n_points,
        n_strands=curves.n_strands,
        n_segments=curves.n_segments,
        longest_strand=int(np.diff(curves.offsets).max()),
        stack_size=tree.stack_size,
        build_seconds=time.perf_counter() - start,
    )


def _upload_vertices(memory: Memory, curves: Curves, point_radii: bool) -> cl.Buffer:
    """What kernels/include/vertices.clh reads, copied a part at a time."""
    n, width = curves.n_points, 4 if point_radii else 3
    head = np.zeros(0 if point_radii else 1, np.float32)
    head[:] = curves.radii[0]
    buffer = memory.allocate("vertices", 4 * (width * n + 2 * len(head)))
    part = np.empty((min(_UPLOAD_POINTS, n), width), np.float32)
    for begin in range(0, n, _UPLOAD_POINTS):
        end = min(begin + _UPLOAD_POINTS, n)
        part[: end - begin, :3] = curves.points[begin:end]
        if point_radii:
            part[: end - begin, 3] = curves.radii[begin:end]
        _write(memory, buffer, part[: end - begin], head.nbytes + part.itemsize * width * begin)
    if not point_radii:
        _write(memory, buffer, head, 0)
    return buffer


def _write(memory: Memory, buffer: cl.Buffer, array: NDArray, offset: int) -> None:
    """Copy an array to a place [bytes] in a buffer and wait."""
    cl.enqueue_copy(memory.device.queue, buffer, array, dst_offset=offset, is_blocking=True)


def _build_chunks(
    memory: Memory, builder: ChunkBuilder, curves: Curves, n_chunks: int, spare_bytes: int
) -> Chunk:
    """Build chunk after chunk, then put their blocks behind those over them."""
    lanes = top_lanes(n_chunks)
    chunks: list[Chunk] = []
    first_blocks = [len(lanes)]
    for i, segments in enumerate(split_segments(curves, n_chunks)):
        chunks.append(builder.build(_name(i), segments, first_blocks[i]))
        first_blocks.append(first_blocks[i] + chunks[i].n_blocks)
    boxes = np.array([chunk.box for chunk in chunks])
    stacks = np.array([chunk.stack_size for chunk in chunks])
    top, stack_size = top_blocks(lanes, boxes, np.array(first_blocks[:-1], np.uint32), stacks)
    n_blocks = first_blocks[-1]
    queue = memory.device.queue
    blocks = memory.allocate("bvh", _BLOCK_BYTES * n_blocks + spare_bytes, zero=spare_bytes > 0)
    cl.enqueue_copy(queue, blocks, top, is_blocking=True)
    for i, chunk in enumerate(chunks):
        cl.enqueue_copy(
            queue,
            blocks,
            chunk.blocks,
            byte_count=_BLOCK_BYTES * chunk.n_blocks,
            dst_offset=_BLOCK_BYTES * first_blocks[i],
        ).wait()
        memory.release(_name(i), chunk.blocks)
    box = np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    return Chunk(blocks, n_blocks, stack_size, box)


def _name(chunk: int) -> str:
    return f"bvh of chunk {chunk}"
