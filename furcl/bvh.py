"""The tree over the segments of a groom: built on the host, read by kernels/include/bvh.clh."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl import bvh_blocks, bvh_native, embree
from furcl.curves import Curves
from furcl.errors import BvhError
from furcl.layout import BVH_BLOCK_WORDS, BVH_STACK_SIZE


@dataclass(frozen=True, eq=False)
class Bvh:
    """A tree of 8-wide blocks and what its leaves refer to.

    Attributes
    ----------
    blocks : (b, 32) uint32             see kernels/include/bvh.clh; block 0 is the root
    vertices : (n_points, 4) float32    x, y, z, radius
    offsets : (S + 1,) uint32           strand s owns vertices offsets[s] .. offsets[s + 1] - 1
    n_segments : int                    segments in the tree
    stack_size : int                    stack entries that a traversal can need
    build_seconds : float               time that the whole build took [s]
    """

    blocks: NDArray[np.uint32]
    vertices: NDArray[np.float32]
    offsets: NDArray[np.uint32]
    n_segments: int
    stack_size: int
    build_seconds: float

    @property
    def n_bytes(self) -> int:
        """Memory on the device [bytes]."""
        return self.blocks.nbytes + self.vertices.nbytes + self.offsets.nbytes

    def validate(self, curves: Curves) -> None:
        """Check the whole tree against the groom; see furcl.bvh_check.

        Raises
        ------
        BvhError    naming the first thing that is wrong
        """
        from furcl.bvh_check import check_bvh

        check_bvh(self, curves)


def build_bvh(curves: Curves) -> Bvh:
    """Build the tree of a groom.

    Raises
    ------
    BvhError    if Embree cannot be used, or if the tree is too deep for the traversal stack
    """
    start = time.perf_counter()
    vertices = curves.segment_vertices()
    primitives = np.zeros(len(vertices), embree.PRIMITIVE)
    bvh_native.segment_boxes(
        curves.points,
        curves.radii,
        vertices,
        primitives["lower"],
        primitives["upper"],
        primitives["primitive"],
    )
    children, bounds = _binary_tree(primitives)
    del primitives
    choice = bvh_native.choose_collapse(children, bounds)
    lanes, refs, stack_size = bvh_native.plan_blocks(children, choice)
    if stack_size > BVH_STACK_SIZE:
        raise BvhError(
            f"the tree of {len(vertices)} segments needs a stack of {stack_size} entries, kernels "
            f"have {BVH_STACK_SIZE}; the groom is extremely uneven: split it"
        )
    del choice
    blocks = np.zeros((len(lanes), BVH_BLOCK_WORDS), np.uint32)
    bvh_blocks.fill_blocks(
        blocks, lanes, refs, children, bounds, curves.points, curves.radii, vertices
    )
    return Bvh(
        blocks=blocks,
        vertices=np.concatenate([curves.points, curves.radii[:, None]], axis=1),
        offsets=curves.offsets.astype(np.uint32),
        n_segments=len(vertices),
        stack_size=stack_size,
        build_seconds=time.perf_counter() - start,
    )


def _binary_tree(primitives):
    """As embree.build_binary_tree; one primitive makes a node with it on both sides."""
    if len(primitives) > 1:
        return embree.build_binary_tree(primitives)
    bounds = np.zeros((1, 2, 2, 4), np.float32)
    bounds[0, :, 0, :3] = primitives["lower"]
    bounds[0, :, 1, :3] = primitives["upper"]
    return np.full((1, 2), ~0, np.int32), bounds
