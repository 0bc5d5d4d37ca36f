"""The tree over the segments of a groom, as kernels/include/bvh/block.clh reads it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.bvh.chunk import ChunkBuilder
from furcl.bvh.partition import Partition, top_blocks, top_lanes
from furcl.device import index_checks
from furcl.device.layout import BLOCK_WORDS, BVH_STACK_SIZE
from furcl.device.memory import Memory
from furcl.errors import BvhError
from furcl.groom.curves import Curves

#: Segments that are built at once: bounds the memory that building needs, about 200 bytes each.
CHUNK_SEGMENTS = 1 << 20

#: The buffers that `build_bvh` leaves in the memory that it is given.
BUFFERS = ("bvh", "vertices", "strands")

BLOCK_BYTES = 4 * BLOCK_WORDS
_UPLOAD_POINTS = 1 << 18
#: How much larger than the chunks so far let expect the buffer of a tree of many chunks is made.
_ROOM = 1.02


@dataclass(frozen=True, eq=False)
class BvhArrays:
    """A tree on the host.

    Attributes
    ----------
    blocks : (b, 32) uint32             see kernels/include/bvh/block.clh
    vertices : (n_points, 4) float32    x, y, z, radius; of a groom that moves (n_points, T, 4)
    offsets : (S + 1,) uint32           strand s owns vertices offsets[s] .. offsets[s + 1] - 1
    stack_size : int                    stack entries that a traversal can need
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
    n_blocks, n_points, n_strands, n_segments : int
    motion : int            pieces of time that the groom moves in, each with a tree; 0: it does not
    stack_size : int        stack entries that a traversal can need
    build_seconds : float   time that the build took, upload of the groom included [s]
    """

    memory: Memory
    blocks: cl.Buffer
    vertices: cl.Buffer
    point_radii: bool
    strands: cl.Buffer
    n_blocks: int
    n_points: int
    n_strands: int
    n_segments: int
    motion: int
    stack_size: int
    build_seconds: float

    @property
    def n_bytes(self) -> int:
        """Memory on the device [bytes]."""
        return self.blocks.size + self.vertices.size + self.strands.size

    def arguments(self) -> list[cl.Buffer]:
        """What kernels take as blocks, vertices and strands, in that order."""
        return [self.blocks, self.vertices, self.strands]

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
    *,
    debug: bool = False,
    chunk_segments: int = CHUNK_SEGMENTS,
) -> Bvh:
    """Build the tree of a groom; what is uploaded or made stays in `memory`.

    Parameters
    ----------
    memory : Memory             takes BUFFERS
    curves : Curves             one that moves has a tree for each piece of time between its steps
    point_radii : bool          False stores the radius of the first point for all
                                (Features.point_radii); a groom that moves has one a vertex
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
        vertices = upload_vertices(memory, "vertices", curves.points, curves.radii, point_radii)
    else:
        point_radii = True
        vertices = _upload_steps(memory, curves.steps, curves.radii)
    n_chunks = 1
    while n_chunks * chunk_segments < curves.n_segments:
        n_chunks *= 8  # as many as fill the lanes of the blocks above them
    spare_bytes = BLOCK_BYTES + index_checks.RECORD_BYTES if debug else 0
    blocks, n_blocks, stack_size = _build_blocks(
        memory, curves, vertices, point_radii, n_chunks, spare_bytes
    )
    motion = max(len(curves.times) - 1, 0)
    if stack_size > BVH_STACK_SIZE:
        raise BvhError(
            f"the tree of {curves.n_segments} segments needs a stack of {stack_size} entries, "
            f"kernels have {BVH_STACK_SIZE}; the groom is extremely uneven: split it"
        )
    return Bvh(
        memory=memory,
        blocks=blocks,
        vertices=vertices,
        point_radii=point_radii,
        strands=index_checks.upload(memory, "strands", strand_ends(curves), debug),
        n_blocks=n_blocks,
        n_points=curves.n_points,
        n_strands=curves.n_strands,
        n_segments=curves.n_segments,
        motion=motion,
        stack_size=stack_size,
        build_seconds=time.perf_counter() - start,
    )


def no_geometry(memory: Memory) -> list[cl.Buffer]:
    """In place of `Bvh.arguments`, for launches over nothing: kernels need every argument."""
    nothing = memory.upload("no geometry", np.zeros(4, np.uint32))
    return [nothing, nothing, nothing]


def watch(checks: index_checks.IndexChecks, geometry: list[cl.Buffer], n_vertices: int) -> None:
    """Watch the indices of a tree: its record is behind the ends of strands."""
    blocks, _, strands = geometry
    n_blocks = (blocks.size - index_checks.RECORD_BYTES) // BLOCK_BYTES - 1
    checks.watch(strands, n_vertices=n_vertices, n_blocks=n_blocks)


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


def upload_vertices(
    memory: Memory,
    name: str,
    points: NDArray[np.float32],
    radii: NDArray[np.float32],
    point_radii: bool,
) -> cl.Buffer:
    """What kernels/include/geometry/curve.clh reads of points (n, 3) and radii (n,), copied a part
    at a time."""
    n, width = len(points), 4 if point_radii else 3
    head = np.zeros(0 if point_radii else 1, np.float32)
    head[:] = radii[0]
    buffer = memory.allocate(name, 4 * (width * n + 2 * len(head)))
    part = np.empty((min(_UPLOAD_POINTS, n), width), np.float32)
    for begin in range(0, n, _UPLOAD_POINTS):
        end = min(begin + _UPLOAD_POINTS, n)
        part[: end - begin, :3] = points[begin:end]
        if point_radii:
            part[: end - begin, 3] = radii[begin:end]
        _write(memory, buffer, part[: end - begin], head.nbytes + part.itemsize * width * begin)
    if not point_radii:
        _write(memory, buffer, head, 0)
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
        _write(memory, buffer, packed, 16 * n_steps * begin)
    return buffer


def _write(memory: Memory, buffer: cl.Buffer, array: NDArray, offset: int) -> None:
    """Copy an array to a place [bytes] in a buffer and wait."""
    cl.enqueue_copy(memory.device.queue, buffer, array, dst_offset=offset, is_blocking=True)


def _build_blocks(
    memory: Memory,
    curves: Curves,
    vertices: cl.Buffer,
    point_radii: bool,
    n_chunks: int,
    spare_bytes: int,
) -> tuple[cl.Buffer, int, int]:
    """Build the tree of each piece of time, or the only one, behind the numbers of their roots;
    blocks, their number, largest stack size."""
    motion = max(len(curves.times) - 1, 0)
    heads = -(-motion // BLOCK_WORDS)  # blocks that the numbers of roots take
    blocks = memory.allocate("bvh", BLOCK_BYTES * max(heads, 1))  # grows with what is learnt
    roots, stack_size = np.zeros(heads * BLOCK_WORDS, np.uint32), 0
    end = heads
    for piece in range(max(motion, 1)):
        roots[piece : piece + 1] = end
        still = curves
        if curves.steps is not None:
            still = curves.with_steps([curves.steps[piece]], curves.times[piece : piece + 1])
        blocks, end, stack = _build_piece(
            memory, still, vertices, point_radii, n_chunks, spare_bytes, blocks, end, piece, motion
        )
        stack_size = max(stack_size, stack)
    if heads:
        _write(memory, blocks, roots, 0)
    return blocks, end, stack_size


def _build_piece(
    memory: Memory,
    curves: Curves,
    vertices: cl.Buffer,
    point_radii: bool,
    n_chunks: int,
    spare_bytes: int,
    blocks: cl.Buffer,
    first: int,
    piece: int,
    motion: int,
) -> tuple[cl.Buffer, int, int]:
    """Build chunk after chunk behind the blocks over them, from block `first` on; blocks, where
    they end, stack size. `curves` is the groom as it is when the piece begins."""
    if n_chunks == 1:
        chunks, sizes = [curves.segment_vertices().view(np.uint32)], [curves.n_segments]
        lanes = []
    else:
        chunks = Partition(curves, n_chunks)
        sizes = chunks.sizes
        lanes = top_lanes(len(sizes), chunks.stray)
    lo, hi = curves.bounds()
    roots, ends = [], [first + len(lanes)]
    with memory.scratch() as scratch:
        builder = ChunkBuilder(
            scratch, vertices, point_radii, float((hi - lo).max()), max(sizes), motion=motion
        )
        builder.step = piece
        for i, segments in enumerate(chunks):
            roots.append(builder.plan(segments))
            ends.append(ends[-1] + roots[-1].n_blocks)
            share = (piece + sum(sizes[: i + 1]) / curves.n_segments) / max(motion, 1)
            blocks = _with_room(memory, blocks, ends[-1], share, spare_bytes)
            builder.write(blocks, first_block=ends[-2])
        memory.device.queue.finish()
    if not lanes:
        return blocks, ends[-1], roots[0].stack_size
    boxes = np.array(
        [root.box + curves.points[root.first_vertex].astype(np.float64) for root in roots]
    )
    stacks = [root.stack_size for root in roots]
    top, stack_size = top_blocks(lanes, boxes, ends[:-1], stacks, first)
    _write(memory, blocks, top, BLOCK_BYTES * first)
    return blocks, ends[-1], stack_size


def _with_room(
    memory: Memory, blocks: cl.Buffer, n_blocks: int, share: float, spare_bytes: int
) -> cl.Buffer:
    """A buffer for `n_blocks` blocks, or for the rest too if they are a `share` of the tree."""
    if blocks.size >= BLOCK_BYTES * n_blocks + spare_bytes:
        return blocks
    if share < 1.0:
        n_blocks = max(n_blocks, math.ceil(_ROOM * n_blocks / share))
    n_bytes = BLOCK_BYTES * n_blocks + spare_bytes
    return memory.grow("bvh", blocks, n_bytes, zero=spare_bytes > 0)
