"""The blocks of all trees over a groom and the triangles beside it, in one buffer."""

from __future__ import annotations

import math

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.bvh.chunk import ChunkBuilder, Root
from furcl.bvh.joint import SUBTREES, corners_of, hang, open_largest
from furcl.bvh.partition import Partition, top_blocks, top_lanes
from furcl.device.layout import (
    BLOCK_ORIGIN,
    BLOCK_REFERENCES,
    BLOCK_ROWS,
    BLOCK_WORDS,
    BVH_STACK_SIZE,
    BVH_WIDTH,
    NO_BLOCK,
)
from furcl.device.memory import Memory
from furcl.groom.curves import Curves

BLOCK_BYTES = 4 * BLOCK_WORDS
#: How much larger than the chunks so far let expect the buffer of a tree of many chunks is made.
_ROOM = 1.02
_UPLOAD_TRIANGLES = 1 << 18


class TreeBuilder:
    """Builds trees behind one another: one over triangles, which keep still, and one over the
    groom, or for each piece of time one over the groom as it is then; beside triangles also the
    top of one over both (furcl.bvh.joint).

    Parameters
    ----------
    memory : Memory             takes the buffer "bvh"
    curves : Curves             as furcl.bvh.build.build_bvh
    vertices : cl.Buffer        its vertices
    point_radii : bool          how vertices are stored
    triangles : tuple or None   corners (n, 3, 3) float32, and the same on the device
    n_chunks : int              that the groom is built in, 1, 8, 64, ...
    spare_bytes : int           more that the buffer has behind the blocks

    Attributes
    ----------
    blocks : cl.Buffer          see kernels/include/bvh/block.clh
    end : int                   number of blocks
    motion : int                pieces of time, 0 for a groom that keeps still
    n_triangles : int
    """

    def __init__(
        self,
        memory: Memory,
        curves: Curves,
        vertices: cl.Buffer,
        point_radii: bool,
        triangles: tuple[NDArray[np.float32], cl.Buffer] | None,
        *,
        n_chunks: int,
        spare_bytes: int,
    ) -> None:
        self._memory = memory
        self._curves = curves
        self._vertices = vertices
        self._point_radii = point_radii
        self._triangles = triangles
        self._n_chunks = n_chunks
        self._spare_bytes = spare_bytes
        self.motion = max(len(curves.times) - 1, 0)
        self.n_triangles = 0 if triangles is None else len(triangles[0])
        self._room_for_joint = 0 if triangles is None else SUBTREES // 4  # blocks; 200 are usual
        several = self.motion > 0 or triangles is not None
        self.end = -(-max(self.motion, 1) // BVH_WIDTH) if several else 0  # blocks of roots
        self.blocks = memory.allocate("bvh", BLOCK_BYTES * max(self.end, 1))  # grows

    def build(self) -> int:
        """Build all trees, and the blocks in front that say where their roots are.

        Returns
        -------
        int     blocks that wait on the stack in a traversal, at most

        Raises
        ------
        BvhError, ResourceError, KernelBuildError
        """
        roots, stack_size = np.zeros((self.end, BLOCK_WORDS), np.uint32), 0
        triangles_size = 0
        if self._triangles is not None:
            roots[0, BLOCK_ORIGIN] = self.end
            triangles_size = self._build_triangles(*self._triangles).stack_size
            stack_size = 1 + triangles_size
        first = self.end  # of the groom's blocks
        for piece in range(max(self.motion, 1)):
            root, (number, lane) = self.end, divmod(piece, BVH_WIDTH)
            own = self._build_piece(piece, first)
            stack_size = max(stack_size, own)
            if len(roots):
                roots[number, BLOCK_REFERENCES + lane] = root
            if self._triangles is not None:
                trees = [(int(roots[0, BLOCK_ORIGIN]), triangles_size), (root, own)]
                joint, joint_size = self._join(trees)
                roots[number, BLOCK_ROWS + lane] = joint
                stack_size = max(stack_size, joint_size)
        if len(roots):
            write_at(self._memory, self.blocks, roots, 0)
        return stack_size

    def _build_triangles(self, corners: NDArray[np.float32], on_device: cl.Buffer) -> Root:
        """Build a tree over triangles."""
        size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
        with self._memory.scratch() as scratch:
            builder = ChunkBuilder(scratch, on_device, True, size, len(corners), triangles=True)
            root = builder.plan(np.arange(0, 3 * len(corners), 3, dtype=np.uint32))
            self._write(builder, root, BLOCK_BYTES * (self.end + root.n_blocks))
            self._memory.device.queue.finish()
        return root

    def _join(self, trees: list[tuple[int, int]]) -> tuple[int, int]:
        """Build the top over trees, of each its root and stack size; its root and stack size.
        NO_BLOCK and 0 where there is none: a small tree, or a stack that would be too deep."""

        def read(first: int, n: int) -> NDArray[np.uint32]:
            shape, offset = (n, BLOCK_WORDS), BLOCK_BYTES * first
            return self._memory.read(self.blocks, shape, np.uint32, offset)

        subtrees = open_largest(read, trees, SUBTREES)
        if not subtrees:
            return NO_BLOCK, 0
        corners, first = corners_of(subtrees), self.end
        with self._memory.scratch() as scratch:
            root = self._build_triangles(corners, upload_corners(scratch, corners))
        blocks = read(first, root.n_blocks)
        stack_size = hang(blocks, first, subtrees)
        if stack_size > BVH_STACK_SIZE:
            return NO_BLOCK, 0
        write_at(self._memory, self.blocks, blocks, BLOCK_BYTES * first)
        return first, stack_size

    def _build_piece(self, piece: int, first: int) -> int:
        """Build chunk after chunk of the groom as it is when a piece of time begins, behind the
        blocks over them; the stack size. The groom's blocks begin at `first`."""
        curves = self._curves
        if curves.steps is not None:
            curves = curves.with_steps([curves.steps[piece]], curves.times[piece : piece + 1])
        if self._n_chunks == 1:
            chunks, sizes = [curves.segment_vertices().view(np.uint32)], [curves.n_segments]
            lanes = []
        else:
            chunks = Partition(curves, self._n_chunks)
            sizes = chunks.sizes
            lanes = top_lanes(len(sizes), chunks.stray)
        top = self.end
        self.end += len(lanes)
        lo, hi = curves.bounds()
        roots, starts = [], []
        with self._memory.scratch() as scratch:
            builder = ChunkBuilder(
                scratch,
                self._vertices,
                self._point_radii,
                float((hi - lo).max()),
                max(sizes),
                motion=self.motion,
            )
            builder.step = piece
            for i, segments in enumerate(chunks):
                root = builder.plan(segments)
                done = (piece + sum(sizes[: i + 1]) / curves.n_segments) / max(self.motion, 1)
                end = self.end + root.n_blocks + self._room_for_joint
                if done < 1.0:  # room for the rest too
                    end = max(end, first + math.ceil(_ROOM * (end - first) / done))
                roots.append(root)
                starts.append(self.end)
                self._write(builder, root, BLOCK_BYTES * end)
            self._memory.device.queue.finish()
        if not lanes:
            return roots[0].stack_size
        boxes = np.array(
            [root.box + curves.points[root.first_vertex].astype(np.float64) for root in roots]
        )
        stacks = [root.stack_size for root in roots]
        blocks, stack_size = top_blocks(lanes, boxes, starts, stacks, top)
        write_at(self._memory, self.blocks, blocks, BLOCK_BYTES * top)
        return stack_size

    def _write(self, builder: ChunkBuilder, root: Root, n_bytes: int) -> None:
        """Write the blocks that were planned, into a buffer that is made at least so large."""
        n_needed = BLOCK_BYTES * (self.end + root.n_blocks) + self._spare_bytes
        if self.blocks.size < n_needed:
            n_bytes += self._spare_bytes
            self.blocks = self._memory.grow("bvh", self.blocks, n_bytes, zero=self._spare_bytes > 0)
        builder.write(self.blocks, first_block=self.end)
        self.end += root.n_blocks


def upload_corners(memory: Memory, corners: NDArray[np.float32]) -> cl.Buffer:
    """What kernels/include/geometry/triangle.clh reads of corners (n, 3, 3), copied a part at a
    time."""
    buffer = memory.allocate("corners", 48 * len(corners))
    for begin in range(0, len(corners), _UPLOAD_TRIANGLES):
        part = corners[begin : begin + _UPLOAD_TRIANGLES]
        packed = np.zeros((len(part), 3, 4), np.float32)
        packed[:, :, :3] = part.transpose(0, 2, 1)
        write_at(memory, buffer, packed, 48 * begin)
    return buffer


def write_at(memory: Memory, buffer: cl.Buffer, array: NDArray, offset: int) -> None:
    """Copy an array to a place [bytes] in a buffer and wait."""
    cl.enqueue_copy(memory.device.queue, buffer, array, dst_offset=offset, is_blocking=True)
