"""The tree: every segment once and inside its bounds, and the checks that say so."""

from __future__ import annotations

import itertools
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from ray_reference import nested, random_walks, strands

from furcl.bvh import embree, needles, trees
from furcl.bvh.build import build_bvh
from furcl.bvh.chunk import BUFFERS, ChunkBuilder
from furcl.bvh.partition import Partition, top_lanes
from furcl.device.choice import Device
from furcl.device.layout import BVH_STACK_SIZE
from furcl.device.memory import Memory
from furcl.errors import BvhError, ResourceError
from furcl.groom.curves import Curves
from furcl.oracle.tree_check import check_bvh


def _helix(rng):
    t = np.linspace(0.0, 40.0, 400)
    return strands(np.stack([np.cos(t), np.sin(t), 0.1 * t], axis=1)[None], 0.02)


def _parallel(rng):
    root = np.concatenate([rng.random((300, 2)), np.zeros((300, 1))], axis=1)
    return strands(root[:, None] + np.linspace([0, 0, 0], [0, 0, 5], 9)[None], 0.01, taper=0.9)


def _repeated(rng):
    """All segments in the same place: no plane parts them."""
    return strands(np.tile([[[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]], (100, 1, 1)), 0.1)


def _uneven(rng):
    """Sizes and distances over 24 orders of magnitude: the deepest trees."""
    scale = 10.0 ** np.linspace(-12, 12, 200)[:, None, None]
    return strands(scale * np.array([[[1.0, 1.0, 1.0], [1.5, 1.0, 1.2]]]), 1e-13)


def _far_away(rng):
    curves = random_walks(rng, 40, 9, 0.2, 0.01)
    return Curves.from_arrays(curves.points + np.float32(1e5), curves.radii, curves.offsets)


def _stray(rng):
    """A point and a strand far away from all others, in opposite directions."""
    points = random_walks(rng, 500, 12, 0.1, 0.005).points.copy()
    points[77] += np.float32(1e5)
    points[240:252] -= np.float32(1e6)
    return Curves.from_arrays(points, 0.005, np.arange(501) * 12)


def _needles(rng):
    """Points two and three sizes away: segments as long as all the rest."""
    points = random_walks(rng, 500, 12, 0.05, 0.005).points.copy()
    points[[77, 1000, 1999]] += np.array([[2.5, 2.5, 2.0], [0.0, -3.0, 1.0], [3.0, 0.0, 0.0]])
    return Curves.from_arrays(points, 0.005, np.arange(501) * 12)


def _on_axes(rng):
    ends = np.zeros((3, 2, 3))
    ends[:, 1] = np.eye(3)
    return strands(ends, 0.01)


GROOMS = {
    "one segment": lambda rng: random_walks(rng, 1, 2, 1.0, 0.1),
    "two segments": lambda rng: random_walks(rng, 1, 3, 1.0, 0.1),
    "nine segments": lambda rng: random_walks(rng, 3, 4, 1.0, 0.1),
    "walks": lambda rng: random_walks(rng, 500, 12, 0.1, 0.005, taper=0.8),
    "thick": lambda rng: random_walks(rng, 50, 6, 0.01, 1.0),
    "long": lambda rng: random_walks(rng, 1000, 2, 3.0, 1e-4),
    "tiny": lambda rng: random_walks(rng, 50, 6, 1e-7, 1e-9),
    "huge": lambda rng: random_walks(rng, 50, 6, 1e6, 1e3),
    "on axes": _on_axes,
    "helix": _helix,
    "parallel": _parallel,
    "repeated": _repeated,
    "uneven": _uneven,
    "far away": _far_away,
    "stray": _stray,
    "needles": _needles,
}


ONE_CHUNK = 1 << 20


@pytest.mark.parametrize("chunk_segments", [ONE_CHUNK, 100])
@pytest.mark.parametrize("name", GROOMS)
def test_holds_every_segment_once_and_inside_its_bounds(device, name, chunk_segments, rng):
    curves = GROOMS[name](rng)
    bvh = build_bvh(Memory(device), curves, chunk_segments=chunk_segments)
    check_bvh(bvh.read(), curves)
    assert bvh.n_segments == curves.n_segments
    assert bvh.stack_size <= BVH_STACK_SIZE


@pytest.mark.parametrize(
    ("per_size", "ratio"), [(1, 1.05), (3, 1.05), (30, 1.05), (10, 2.0), (30, 2.0)]
)
def test_six_orders_of_magnitude_fit_the_stack(device, per_size, ratio, rng):
    bvh = build_bvh(Memory(device), nested(rng, 6, per_size, ratio))
    assert bvh.stack_size <= BVH_STACK_SIZE


def test_a_tree_too_deep_for_the_stack_is_refused(device, rng):
    with pytest.raises(BvhError, match=r"needs a stack of \d+ blocks, .*extremely uneven"):
        build_bvh(Memory(device), nested(rng, 30))


def test_one_radius_is_stored_once(device, rng):
    curves = random_walks(rng, 500, 12, 0.1, 0.005)
    bvh = build_bvh(Memory(device), curves, point_radii=False)
    check_bvh(bvh.read(), curves)
    assert bvh.n_bytes == build_bvh(Memory(device), curves).n_bytes - 4 * (curves.n_points - 2)


@pytest.mark.parametrize("chunk_segments", [ONE_CHUNK, 10_000])
def test_is_compact(device, chunk_segments, rng):
    curves = random_walks(rng, 20_000, 11, 0.02, 0.001)
    bvh = build_bvh(Memory(device), curves, chunk_segments=chunk_segments)
    assert bvh.n_bytes / curves.n_segments < 48


@pytest.mark.parametrize("share", [0.6, 0.9])
def test_a_tree_larger_than_the_device_allows_is_refused_at_once(device, share, rng, monkeypatch):
    """Not when all its chunks are built but for the last."""
    curves = random_walks(rng, 20_000, 11, 0.02, 0.001)
    allowed = int(share * build_bvh(Memory(device), curves).memory.bytes["bvh"])
    built = []
    plan = ChunkBuilder.plan
    monkeypatch.setattr(ChunkBuilder, "plan", lambda *a: built.append(a) or plan(*a))
    monkeypatch.setattr(Device, "max_allocation_bytes", allowed)
    with pytest.raises(ResourceError, match=r"'bvh' needs \d+ MiB, .* allows \d+ MiB"):
        build_bvh(Memory(device), curves, point_radii=False, chunk_segments=4_000)
    assert len(built) == 1


@pytest.mark.parametrize("chunk_segments", [ONE_CHUNK, 10_000])
def test_is_the_same_every_time(device, chunk_segments, rng):
    curves = random_walks(rng, 20_000, 6, 0.02, 0.001)
    first, second = (
        build_bvh(Memory(device), curves, chunk_segments=chunk_segments).read() for _ in range(2)
    )
    assert np.array_equal(first.blocks, second.blocks)


@pytest.mark.parametrize("n_chunks", [2, 3, 8, 11, 100])
def test_the_top_of_the_tree_holds_every_chunk_once(n_chunks):
    blocks = top_lanes(n_chunks)
    lanes = [lane for block in blocks for lane in block]
    assert sorted(begin for begin, end in lanes if end - begin == 1) == list(range(n_chunks))
    spans = [(block[0][0], block[-1][1]) for block in blocks]
    assert spans[0] == (0, n_chunks)
    assert spans[1:] == [lane for lane in lanes if lane[1] - lane[0] > 1]
    for block in blocks:
        assert 2 <= len(block) <= 8
        assert all(a[1] == b[0] for a, b in itertools.pairwise(block))


def test_chunks_are_apart(rng):
    """Cutting by midpoints makes chunks of one size that hardly overlap."""
    curves = random_walks(rng, 3000, 8, 0.001, 0.0001)
    partition = Partition(curves, 7)
    chunks = list(partition)
    assert np.array_equal(np.sort(np.concatenate(chunks)), curves.segment_vertices())
    assert [len(chunk) for chunk in chunks] == partition.sizes
    assert max(partition.sizes) < 1.1 * curves.n_segments / 7
    boxes = [(curves.points[c].min(axis=0), curves.points[c].max(axis=0)) for c in chunks]
    volume = sum(np.prod(hi - lo) for lo, hi in boxes)
    assert volume < 1.1 * np.prod(np.ptp(curves.points, axis=0))


def test_scratch_memory_is_bounded_by_the_chunk(device, rng):
    curves = random_walks(rng, 20_000, 11, 0.02, 0.001)
    for chunk_segments in (ONE_CHUNK, 20_000):  # 200 000 segments: 1 chunk, 64 chunks
        memory = Memory(device)
        held = build_bvh(memory, curves, chunk_segments=chunk_segments).n_bytes
        assert memory.total_bytes == held
        n = curves.n_segments // (1 if chunk_segments == ONE_CHUNK else 64)
        scratch = sum(BUFFERS.values()) * n
        without_offsets = held - memory.bytes["strands"]
        assert without_offsets + 0.95 * scratch < memory.peak_bytes < held + 1.1 * scratch


def test_the_buffer_of_blocks_grows(device, rng, monkeypatch):
    """Chunks that need more blocks than the first let expect."""
    monkeypatch.setattr(trees, "_ROOM", 0.5)
    curves = random_walks(rng, 2000, 8, 0.05, 0.002)
    check_bvh(build_bvh(Memory(device), curves, chunk_segments=2000).read(), curves)


def _kinds(bvh, flag):
    """Blocks of boxes (True) or capsules."""
    return np.flatnonzero((bvh.blocks[:, 22] >> 16 & 1).astype(bool) == flag)


def _block_with(bvh, subtrees):
    """A block of capsules of which lane 0 is a segment, or the last lane in use a subtree."""
    kinds = bvh.blocks[:, 22]
    used, segments = kinds & 255, kinds >> 8 & 255
    mixed = (kinds >> 16 == 0) & (segments > 0) & ((segments != used) == subtrees)
    return int(np.flatnonzero(mixed)[0])


def _lose_segment(blocks, bvh):
    block = _block_with(bvh, False)
    blocks[block, 22] &= ~np.uint32(0x101)


def _repeat_segment(blocks, bvh):
    block = _block_with(bvh, False)
    blocks[block, 24] = blocks[block, 25]


def _wrong_child(blocks, bvh):
    block = _block_with(bvh, True)
    lane = int(blocks[block, 22] & 255).bit_length() - 1
    blocks[block, 24 + lane] += 1


def _cycle(blocks, bvh):
    block = _block_with(bvh, True)
    lane = int(blocks[block, 22] & 255).bit_length() - 1
    blocks[block, 24 + lane] = block


def _narrow_capsule(blocks, bvh):
    blocks.view(np.uint8)[_block_with(bvh, False), 80] //= 2


def _moved_end(blocks, bvh):
    row = blocks.view(np.uint8)[_block_with(bvh, False)]
    row[32] = 255 - row[32]


def _moved_face(blocks, bvh):
    row = blocks.view(np.uint8)[_kinds(bvh, True)[0]]
    row[40:48] //= 2


def _shifted_grid(blocks, bvh):
    floats = blocks.view(np.float32)
    floats[_kinds(bvh, True)[-1], 0] += 0.05


def _shrunk_grid(blocks, bvh):
    blocks.view(np.float32)[0, 4:7] *= 0.98


def _uneven_steps(blocks, bvh):
    blocks.view(np.float32)[_block_with(bvh, False), 5] *= 1.000001


def _box_of_segments(blocks, bvh):
    blocks[_block_with(bvh, False), 22] |= 1 << 16


MUTANTS = [
    _lose_segment, _repeat_segment, _wrong_child, _cycle, _narrow_capsule, _moved_end, _moved_face,
    _shifted_grid, _shrunk_grid, _uneven_steps, _box_of_segments,
]  # fmt: skip


@pytest.mark.parametrize("mutate", MUTANTS, ids=lambda f: f.__name__.strip("_"))
def test_a_corrupted_block_is_found(device, mutate, rng):
    curves = random_walks(rng, 2000, 8, 0.05, 0.002)
    bvh = build_bvh(Memory(device), curves).read()
    blocks = bvh.blocks.copy()
    mutate(blocks, bvh)
    with pytest.raises(BvhError):
        check_bvh(replace(bvh, blocks=blocks), curves)


def test_wrong_copies_are_found(device, rng):
    curves = random_walks(rng, 20, 8, 0.05, 0.002)
    bvh = build_bvh(Memory(device), curves).read()
    for changed in (
        replace(bvh, stack_size=0),
        replace(bvh, stack_size=bvh.stack_size + 1),
        replace(bvh, vertices=bvh.vertices + np.float32(1e-3)),
        replace(bvh, offsets=bvh.offsets + np.uint32(1)),
        replace(bvh, blocks=bvh.blocks[:, :-1]),
    ):
        with pytest.raises(BvhError):
            check_bvh(changed, curves)


@pytest.mark.parametrize(
    ("n", "long", "kept_out"),
    [(1, 0, 0), (2, 0, 0), (1000, 0, 0), (1000, 1, 1), (1000, 5, 5), (1000, 6, 6), (1000, 7, 0),
     (7, 1, 0)],
)  # fmt: skip
def test_a_binary_tree_has_all_primitives_and_few_long_ones_at_its_top(n, long, kept_out, rng):
    primitives = np.zeros(n, embree.PRIMITIVE)
    primitives["lower"] = rng.random((n, 3))
    primitives["upper"] = primitives["lower"] + 0.01
    chosen = rng.choice(n, long, replace=False)
    primitives["upper"][chosen] += rng.uniform(1.0, 3.0, (long, 3))
    primitives["primitive"] = np.arange(n)
    boxes = primitives.copy()
    tree = needles.build_binary_tree(primitives)
    top, node = [], 0
    while n > 1 and node >= 0 and tree.nodes[node, 1] < 0:
        top.append(int(primitives["primitive"][~tree.nodes[node, 1]]))
        node = int(tree.nodes[node, 0])
    assert kept_out in (0, len(top))
    assert set(top) == set(chosen.tolist()) or not kept_out
    assert np.array_equal(boxes[primitives["primitive"]], primitives)
    below = {~leaf: (leaf, leaf, 0) for leaf in range(n)}  # first and last leaf, height
    for node in np.argsort(tree.heights):
        left, right = sorted(below[int(child)] for child in tree.nodes[node, :2])
        assert left[1] + 1 == right[0] or n == 1
        below[int(node)] = left[0], right[1], 1 + max(left[2], right[2])
        assert below[int(node)] == (*tree.nodes[node, 2:], tree.heights[node])
    assert below[0][:2] == (0, n - 1)


def test_building_needs_no_numba():
    """It is there for benchmarks only, and takes longer to load than a tree to build."""
    code = (
        "import sys, furcl.rendering.renderer\n"
        "from furcl.bvh import embree_callbacks\n"
        "embree_callbacks.compiled()\n"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_another_embree_is_refused():
    embree.check_version(40400, "libembree4.so")
    with pytest.raises(BvhError, match=r"Embree 3\.13.*install embreex 4\.4"):
        embree.check_version(31305, "libembree3.so")


@pytest.mark.parametrize("name", embree.STRUCT_BYTES)
def test_another_struct_layout_is_refused(name):
    with pytest.raises(BvhError, match=name):
        embree.check_struct_sizes({**embree.STRUCT_BYTES, name: embree.STRUCT_BYTES[name] + 8})


def test_a_missing_library_is_named(tmp_path):
    with pytest.raises(BvhError, match=r"no libtbb.*pip install"):
        embree.find_libraries(tmp_path)
