"""The top over subtrees of a groom and of triangles, block by block and by what rays find."""

from __future__ import annotations

import numpy as np
import pytest

from furcl.bvh import trees
from furcl.bvh.build import build_bvh
from furcl.bvh.joint import corners_of, lane_boxes, open_largest
from furcl.device.layout import (
    BLOCK_BOXES,
    BLOCK_LANES,
    BLOCK_ORIGIN,
    BLOCK_REFERENCES,
    BLOCK_ROWS,
    BLOCK_TRIANGLES,
    NO_BLOCK,
    NO_SEGMENT,
)
from furcl.device.memory import Memory
from furcl.groom.curves import Curves
from furcl.groom.grow import GENERATORS
from furcl.rendering.rays import Rays, Tracer

N_TRIANGLES = 3000


@pytest.fixture(scope="module")
def groom():
    return GENERATORS["fur"](n_strands=3000, n_points=5)


@pytest.fixture(scope="module")
def corners():
    """Small triangles in and around the fur."""
    rng = np.random.default_rng(8)
    middle = rng.normal(size=(N_TRIANGLES, 1, 3))
    middle *= rng.uniform(0.8, 1.3, (N_TRIANGLES, 1, 1)) / np.linalg.norm(middle, axis=2)[..., None]
    return (middle + 0.02 * rng.normal(size=(N_TRIANGLES, 3, 3))).astype(np.float32)


def lanes(block):
    """Kind of its leaves, references of these, references of its subtrees."""
    kinds = int(block[BLOCK_LANES])
    n, n_leaves = (kinds & 255).bit_count(), (kinds >> 8 & 255).bit_count()
    references = block[BLOCK_REFERENCES : BLOCK_REFERENCES + n].tolist()
    return bool(kinds & BLOCK_TRIANGLES), references[:n_leaves], references[n_leaves:]


def below(blocks, root):
    """Segments, triangles (first vertices, as often as they are met) and the stack needed."""
    triangles, leaves, children = lanes(blocks[root])
    found = ([], leaves) if triangles else (leaves, [])
    segments, triangles, stack = [*found[0]], [*found[1]], 0
    for child in children:
        more = below(blocks, child)
        segments += more[0]
        triangles += more[1]
        stack = max(stack, more[2])
    return segments, triangles, stack + (len(children) > 1)


def joint_blocks(blocks, root, others):
    """Blocks of the top: those from its root on that are in neither of the two trees."""
    return [root] + [
        block
        for child in lanes(blocks[root])[2]
        if child not in others
        for block in joint_blocks(blocks, child, others)
    ]


def tree_of(blocks, root):
    """All blocks of a tree."""
    return {root}.union(*(tree_of(blocks, child) for child in lanes(blocks[root])[2]))


def test_everything_is_below_its_root_once_and_in_its_boxes(device, groom, corners):
    bvh = build_bvh(Memory(device), groom, corners=corners)
    blocks = bvh.read().blocks
    joint, own, of_triangles = (
        int(blocks[0, place]) for place in (BLOCK_ROWS, BLOCK_REFERENCES, BLOCK_ORIGIN)
    )
    segments, triangles, stack = below(blocks, joint)
    assert sorted(segments) == sorted(below(blocks, own)[0]) == groom.segment_vertices().tolist()
    assert sorted(triangles) == list(range(0, 3 * N_TRIANGLES, 3))
    assert stack <= bvh.stack_size
    top = joint_blocks(blocks, joint, tree_of(blocks, own) | tree_of(blocks, of_triangles))
    assert len(top) > 20
    for number in top:
        block = blocks[number]
        assert int(block[BLOCK_LANES]) >> 8 == BLOCK_BOXES >> 8  # boxes, of subtrees alone
        boxes = lane_boxes(block)
        assert boxes is not None
        for child, box in zip(lanes(block)[2], boxes, strict=True):
            vertices, first, _ = below(blocks, child)
            ends = np.concatenate([vertices, np.add(vertices, 1)]).astype(np.int64)
            points, radii = groom.points[ends].astype(np.float64), groom.radii[ends, None]
            mesh = corners[np.array(first, np.int64) // 3].reshape(-1, 3).astype(np.float64)
            for low, high in ((points - radii, points + radii), (mesh, mesh)):
                assert (low >= box[0]).all()
                assert (high <= box[1]).all()


def traced(device, groom, corners):
    """What rays through the fur find, and whether any: nearest hits alone go by the top."""
    rng = np.random.default_rng(3)
    origins = rng.normal(size=(20_000, 3)).astype(np.float32)
    aims = rng.normal(size=(20_000, 3)) * 0.6 - origins
    directions = (aims / np.linalg.norm(aims, axis=1, keepdims=True)).astype(np.float32)
    tracer = Tracer(device, groom, corners=corners)
    rays = Rays(tracer.memory, origins, directions)
    tracer.closest(rays)
    t, name, _ = tracer.hits(rays)
    tracer.shadow(rays)
    assert np.array_equal(tracer.occluded(rays), name != NO_SEGMENT)
    return tracer.bvh, t, name


@pytest.mark.parametrize("subtrees", [2, 9, 100_000])
def test_hits_do_not_depend_on_what_is_opened(device, groom, corners, monkeypatch, subtrees):
    _, *expected = traced(device, groom, corners)
    monkeypatch.setattr(trees, "SUBTREES", subtrees)
    bvh, *found = traced(device, groom, corners)
    assert bvh.read().blocks[0, BLOCK_ROWS] != NO_BLOCK
    assert all(np.array_equal(a, b) for a, b in zip(expected, found, strict=True))


def test_a_top_that_needs_too_deep_a_stack_is_left_out(device, groom, corners, monkeypatch):
    bvh, *expected = traced(device, groom, corners)
    monkeypatch.setattr(trees, "BVH_STACK_SIZE", bvh.stack_size - 1)
    sequential, *found = traced(device, groom, corners)
    assert sequential.read().blocks[0, BLOCK_ROWS] == NO_BLOCK
    assert sequential.stack_size < bvh.stack_size
    assert all(np.array_equal(a, b) for a, b in zip(expected, found, strict=True))


def test_a_groom_of_few_segments_has_none(device, corners):
    points = np.array([[0, 0, -2], [0, 0, 0], [0, 0, 2]], np.float32)
    few = Curves.from_arrays(points, np.full(3, 0.01, np.float32), [0, 3])
    bvh, t, _ = traced(device, few, corners)
    assert bvh.read().blocks[0, BLOCK_ROWS] == NO_BLOCK
    assert np.isfinite(t).mean() > 0.1


def test_subtrees_hold_all_and_are_bounded(device, groom, corners):
    bvh = build_bvh(Memory(device), groom, corners=corners)
    blocks = bvh.read().blocks
    root = int(blocks[0, BLOCK_REFERENCES])
    needed = below(blocks, root)[2]
    for n in (1, 8, 60, 10_000):
        subtrees = open_largest(lambda i, k: blocks[i : i + k], [(root, needed)], n)
        assert len(subtrees) <= n + 7
        found = [below(blocks, subtree.block) for subtree in subtrees]
        segments = sorted(vertex for each in found for vertex in each[0])
        assert segments == groom.segment_vertices().tolist()
        assert all(each[2] <= s.stack_size for each, s in zip(found, subtrees, strict=True))
        rounded = corners_of(subtrees)
        boxes = np.array([subtree.box for subtree in subtrees])
        assert (rounded.min(axis=1) <= boxes[:, 0]).all()
        assert (rounded.max(axis=1) >= boxes[:, 1]).all()
