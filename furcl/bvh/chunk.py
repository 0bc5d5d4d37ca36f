"""The tree of up to some million segments: Embree's binary tree, made into blocks on the device."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

from furcl.bvh import embree, needles
from furcl.device import program
from furcl.device.features import Features
from furcl.device.launch import grid
from furcl.device.layout import NO_BLOCK
from furcl.device.memory import Memory

# Bytes of a node, or of a segment, in the buffers of kernels/prepare/bvh_build.cl.
BUFFERS = {
    "segments": 4,
    "boxes, then costs": embree.PRIMITIVE.itemsize,
    "leaves": 4,
    "nodes": 16,
    "by height": 4,
    "summaries": 32,
    "choices": 8,
    "places": 8,
}


@dataclass(frozen=True, eq=False)
class Root:
    """What is known of a chunk before its blocks are written.

    Attributes
    ----------
    n_blocks, stack_size : int      as of furcl.bvh.build.Bvh
    first_vertex : int              of the segment of the first leaf
    box : (2, 3) float32            lower and upper corner of all its segments with their radii,
                                    relative to that vertex
    """

    n_blocks: int
    stack_size: int
    first_vertex: int
    box: NDArray[np.float32]


class ChunkBuilder:
    """Builds chunks of one groom, whose vertices are on the device, one after the other.

    Parameters
    ----------
    scratch : Memory            takes BUFFERS, which all chunks share
    vertices : cl.Buffer        of the whole groom, see kernels/include/geometry/curve.clh
    point_radii : bool          whether they have a radius each
    size : float                of the groom, any measure of it
    capacity : int              segments of the largest chunk
    triangles : bool            triangles of three vertices each take the place of segments
    motion : int                pieces of time that the vertices move in, see Features.motion

    Attributes
    ----------
    step : int                  the time step with which the piece begins that trees are built for

    Raises
    ------
    KernelBuildError, ResourceError
    """

    def __init__(
        self,
        scratch: Memory,
        vertices: cl.Buffer,
        point_radii: bool,
        size: float,
        capacity: int,
        triangles: bool = False,
        motion: int = 0,
    ) -> None:
        self._build_binary_tree = (
            embree.build_binary_tree if triangles else needles.build_binary_tree
        )
        self._scratch = scratch
        self._vertices = vertices
        self._inverse_size = np.float32(1.0 / size)
        self._buffers = {
            name: scratch.allocate(name, n_bytes * capacity) for name, n_bytes in BUFFERS.items()
        }
        self._primitives = np.empty(capacity, embree.PRIMITIVE)
        self.step = 0
        self._motion = motion
        self._levels: list[tuple[int, int]] = []
        self._n_blocks = 0
        built = program.build(
            scratch.device,
            "prepare/bvh_build.cl",
            Features(point_radii=point_radii, motion=motion),
            {"FURCL_TRIANGLES": int(triangles)},
        )
        names = ("bound_segments", "summarise", "place_blocks", "fill_blocks")
        self._bound, self._summarise, self._place, self._fill = (
            program.kernel_of(built, name) for name in names
        )

    def plan(self, segments: NDArray[np.uint32]) -> Root:
        """Build the binary tree of some segments and choose how to make blocks of it.

        Parameters
        ----------
        segments : (n,) uint32, 1 <= n <= capacity      their first vertices

        Raises
        ------
        BvhError        if Embree cannot be used or fails
        """
        tree = self._binary_tree(segments)
        ends = np.cumsum(np.bincount(tree.heights)).tolist()
        self._levels = list(itertools.pairwise(ends))
        self._copy("nodes", tree.nodes)
        self._copy("by height", np.argsort(tree.heights, kind="stable").astype(np.uint32))
        places = np.full((len(tree.nodes), 2), NO_BLOCK, np.uint32)
        places[0] = 0, 1
        self._copy("places", places)
        for begin, end in self._levels:
            self._run(
                self._summarise, end - begin, np.uint32(begin), np.uint32(end),
                *self._some("by height", "nodes", "leaves"), self._vertices, self._inverse_size,
                *self._some("summaries", "boxes, then costs", "choices"), *self._piece,
            )  # fmt: skip
        root = self._scratch.read(self._buffers["summaries"], (2, 4))
        self._n_blocks, stack_size = (int(n) for n in root[:, 3].view(np.uint32))
        first_vertex = int(self._primitives["primitive"][0])
        return Root(self._n_blocks, stack_size, first_vertex, root[:, :3].copy())

    def write(self, blocks: cl.Buffer, first_block: int) -> None:
        """Write the blocks that were planned last; starts the work and does not wait.

        Parameters
        ----------
        blocks : cl.Buffer      (at least first_block + n_blocks, 32) uint32
        """
        first = np.uint32(first_block)
        for begin, end in reversed(self._levels):
            self._run(
                self._place, end - begin, np.uint32(begin), np.uint32(end),
                *self._some("by height", "nodes", "leaves", "summaries", "choices"), first,
                *self._some("places"), blocks,
            )  # fmt: skip
        self._run(
            self._fill, self._n_blocks, np.uint32(self._n_blocks), first, blocks,
            *self._some("nodes", "leaves", "summaries"), self._vertices, self._inverse_size,
            *self._piece,
        )  # fmt: skip

    def _binary_tree(self, segments) -> embree.BinaryTree:
        """Embree's tree; what its leaves are goes to the buffer "leaves"."""
        n = len(segments)
        self._copy("segments", segments)
        self._run(
            self._bound, n, np.uint32(n),
            *self._some("segments"), self._vertices, *self._some("boxes, then costs"), *self._piece,
        )  # fmt: skip
        primitives = self._primitives[:n]
        cl.enqueue_copy(self._scratch.device.queue, primitives, self._buffers["boxes, then costs"])
        tree = self._build_binary_tree(primitives)
        self._copy("leaves", primitives["primitive"].copy())
        return tree

    @property
    def _piece(self) -> list[np.uint32]:
        """What tells kernels the piece of time."""
        return [np.uint32(self.step)] if self._motion else []

    def _some(self, *names: str) -> list[cl.Buffer]:
        return [self._buffers[name] for name in names]

    def _copy(self, name: str, array: NDArray) -> None:
        cl.enqueue_copy(self._scratch.device.queue, self._buffers[name], array, is_blocking=True)

    def _run(self, kernel: cl.Kernel, n: int, *arguments) -> None:
        kernel(self._scratch.device.queue, *grid(n), *arguments)
