"""The tree of up to some million segments: Embree's binary tree, made into blocks on the device."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl import embree, program
from furcl.buffers import Memory
from furcl.features import Features
from furcl.layout import BVH_BLOCK_WORDS

LOCAL_SIZE = 64
NOWHERE = 0xFFFFFFFF
# Bytes of a node in the buffers of kernels/bvh_build.cl.
SUMMARY_BYTES, COST_BYTES, CHOICE_BYTES, PLACE_BYTES = 32, 32, 8, 8


@dataclass(frozen=True, eq=False)
class Chunk:
    """Blocks of one chunk on the device.

    Attributes
    ----------
    blocks : cl.Buffer              (n_blocks, 32) uint32, see kernels/include/bvh.clh
    n_blocks, stack_size : int      as of furcl.bvh.Bvh
    box : (2, 3) float32            lower and upper corner of all its segments with their radii
    """

    blocks: cl.Buffer
    n_blocks: int
    stack_size: int
    box: NDArray[np.float32]


class ChunkBuilder:
    """Builds chunks of one groom, whose vertices are on the device.

    Parameters
    ----------
    memory : Memory             of the device; takes the blocks under the names given to `build`
    vertices : cl.Buffer        of the whole groom, see kernels/include/vertices.clh
    point_radii : bool          whether they have a radius each
    size : float                of the groom, any measure of it

    Raises
    ------
    KernelBuildError
    """

    def __init__(self, memory: Memory, vertices: cl.Buffer, point_radii: bool, size: float) -> None:
        self.memory = memory
        self.vertices = vertices
        self.inverse_size = np.float32(1.0 / size)
        built = program.build(memory.device, "bvh_build.cl", Features(point_radii=point_radii))
        names = ("bound_segments", "summarise", "place_blocks", "fill_blocks")
        self._bound, self._summarise, self._place, self._fill = (
            cl.Kernel(built, name) for name in names
        )

    def build(
        self, name: str, segments: NDArray[np.uint32], first_block: int, spare_bytes: int = 0
    ) -> Chunk:
        """Build the tree of some segments.

        Parameters
        ----------
        name : str                      of the buffer of blocks
        segments : (n,) uint32, n >= 1  their first vertices
        first_block : int               number of the chunk's first block in the whole tree
        spare_bytes : int               zeros behind the blocks, a multiple of 4

        Raises
        ------
        BvhError, ResourceError
        """
        with self.memory.scratch() as scratch:
            tree, leaves = self._binary_tree(scratch, segments)
            inputs = (
                scratch.upload("nodes by height", _by_height(tree.heights)),
                scratch.upload("nodes", tree.nodes),
                scratch.upload("leaves", leaves),
            )
            levels = _levels(tree.heights)
            n_nodes = len(tree.nodes)
            del tree, leaves
            summaries = scratch.allocate("summaries", SUMMARY_BYTES * n_nodes)
            choices = scratch.allocate("choices", CHOICE_BYTES * n_nodes)
            self._sum_up(scratch, levels, n_nodes, inputs, summaries, choices)
            root = scratch.read(summaries, (2, 4))
            n_blocks, stack_size = (int(n) for n in root[:, 3].view(np.uint32))
            n_bytes = 4 * BVH_BLOCK_WORDS * n_blocks + spare_bytes
            blocks = self.memory.allocate(name, n_bytes, zero=spare_bytes > 0)
            self._write(
                scratch, levels, n_nodes, inputs, summaries, choices, first_block, blocks, n_blocks
            )
            self.memory.device.queue.finish()
        return Chunk(blocks, n_blocks, stack_size, root[:, :3].copy())

    def _binary_tree(self, scratch: Memory, segments) -> tuple[embree.BinaryTree, NDArray]:
        """Embree's tree, and the first vertex of the segment of each of its leaves."""
        n = len(segments)
        boxes = scratch.allocate("boxes", embree.PRIMITIVE.itemsize * n)
        numbers = scratch.upload("segments", segments)
        self._run(self._bound, n, np.uint32(n), numbers, self.vertices, boxes)
        primitives = scratch.read(boxes, n, embree.PRIMITIVE)
        scratch.release("boxes", boxes)
        scratch.release("segments", numbers)
        tree = embree.build_binary_tree(primitives)
        return tree, primitives["primitive"].copy()

    def _sum_up(self, scratch, levels, n_nodes, inputs, summaries, choices) -> None:
        costs = scratch.allocate("costs", COST_BYTES * n_nodes)
        results = (summaries, costs, choices)
        for begin, end in levels:
            self._run_level(
                self._summarise, begin, end, *inputs, self.vertices, self.inverse_size, *results
            )
        scratch.release("costs", costs)

    def _write(
        self, scratch, levels, n_nodes, inputs, summaries, choices, first_block, blocks, n_blocks
    ) -> None:
        places = np.full((n_nodes, 2), NOWHERE, np.uint32)
        places[0] = 0, 1
        places = scratch.upload("places", places)
        for begin, end in reversed(levels):
            self._run_level(
                self._place, begin, end, *inputs, summaries, choices,
                np.uint32(first_block), places, blocks,
            )  # fmt: skip
        _, nodes, leaves = inputs
        self._run(
            self._fill, n_blocks, np.uint32(n_blocks),
            blocks, nodes, leaves, summaries, self.vertices, self.inverse_size,
        )  # fmt: skip

    def _run_level(self, kernel: cl.Kernel, begin: int, end: int, *arguments) -> None:
        self._run(kernel, end - begin, np.uint32(begin), np.uint32(end), *arguments)

    def _run(self, kernel: cl.Kernel, n: int, *arguments) -> None:
        size = (-(-n // LOCAL_SIZE) * LOCAL_SIZE,)
        kernel(self.memory.device.queue, size, (LOCAL_SIZE,), *arguments)


def _by_height(heights: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """The nodes, lowest first."""
    return np.argsort(heights, kind="stable").astype(np.uint32)


def _levels(heights: NDArray[np.uint8]) -> list[tuple[int, int]]:
    """Where the nodes of each height begin and end among `_by_height`, lowest first."""
    ends = np.cumsum(np.bincount(heights)).tolist()
    return list(itertools.pairwise(ends))
