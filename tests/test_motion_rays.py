"""Rays at times among grooms that move, against float64 brute force on the groom of each time."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_mutants import substitute
from ray_reference import brute_force, random_walks, rays_at

from furcl.bvh.build import build_bvh
from furcl.device.layout import BLOCK_REFERENCES, NO_SEGMENT
from furcl.device.memory import Memory
from furcl.groom.curves import Curves
from furcl.groom.motion import points_at
from furcl.rendering.rays import Rays, Tracer

TIMES = (0.0, 0.3, 1.0)
# Time in steps, and in the unit of TIMES.
MOMENTS = {0.0: 0.0, 0.5: 0.15, 1.0: 0.3, 1.25: 0.475, 2.0: 1.0}


def moving(rng, shift=0.0):
    """Walks that go elsewhere, each its own way, and bend, over three steps."""
    walks = random_walks(rng, 60, 8, 0.2, 0.02, taper=0.5)
    ways = np.cumsum(0.3 * rng.standard_normal((3, 60, 1, 3)), axis=0)
    ways[0] = 0.0
    bent = 0.03 * rng.standard_normal((3, 60, 8, 3))
    steps = (walks.points.reshape(60, 8, 3) + ways + bent).reshape(3, -1, 3) + shift
    return Curves.from_arrays(steps, walks.radii, walks.offsets, times=TIMES)


def at(curves, time):
    return Curves.from_arrays(points_at(curves, time), curves.radii, curves.offsets)


def disagreements(tracer, curves, rng, n=1500):
    """Of rays whose result brute force is sure of: how many hit and should not or the other way
    round, how many hit; and the largest error of their distances."""
    wrong, hits, error = 0, 0, 0.0
    for moment, time in MOMENTS.items():
        still = at(curves, time)
        origins, directions = rays_at(rng, still, n)
        t_ref, segment_ref, _, margin = brute_force(still, origins, directions)
        sure = margin > 1e-3
        assert sure.mean() > 0.98
        rays = Rays(tracer.memory, origins, directions, times=moment)
        tracer.closest(rays)
        t, segment, _ = tracer.hits(rays)
        tracer.shadow(rays)
        hit = segment_ref != NO_SEGMENT
        for found in (segment != NO_SEGMENT, tracer.occluded(rays)):
            wrong += int(((found != hit) & sure).sum())
        both = sure & hit & (segment != NO_SEGMENT)
        hits += int(both.sum())
        error = max(error, float(np.abs(t[both] - t_ref[both]).max()))
    return wrong, hits, error


def test_hits_at_a_time_are_those_of_the_groom_at_that_time(device, rng):
    """Measured: distances are off by 6e-7."""
    curves = moving(rng)
    wrong, hits, error = disagreements(Tracer(device, curves), curves, rng)
    assert wrong == 0
    assert hits > 500
    assert error < 1e-5


def test_chunks_and_a_place_far_away(device, rng):
    """Trees of several chunks a piece of time; at 1000 rounding moves vertices by 6e-5."""
    curves = moving(rng, shift=1000.0)
    tracer = Tracer(device, curves)
    whole = tracer.bvh
    chunked = build_bvh(Memory(device), curves, chunk_segments=100)
    assert chunked.n_blocks > whole.n_blocks
    for tree in (whole, chunked):
        tracer.geometry = tree.arguments()
        wrong, hits, error = disagreements(tracer, curves, rng, 600)
        assert wrong == 0
        assert hits > 150
        assert error < 1e-2


MUTANTS = {
    "the second step of a piece is forgotten": (r"to - from, from\)", "0.0f, from)"),
    "all pieces have the first one's tree": (r"FURCL_BLOCK_REFERENCES \+ lane\];\n#endif",
                                             "FURCL_BLOCK_REFERENCES];\n#endif"),
    "lanes hold their segments at the first step only": (r"#define SEGMENT_ENDS \(.*\)",
                                                         "#define SEGMENT_ENDS 2u"),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTANTS)
def test_mutants_hit_elsewhere(device, rng, monkeypatch, name):
    pattern, text = MUTANTS[name]
    within = "prepare/bvh_build.cl" if "lanes" in name else "tools/trace_rays.cl"
    substitute(monkeypatch, pattern, text, within=within)
    curves = moving(rng)
    wrong, _, _ = disagreements(Tracer(device, curves), curves, rng, 500)
    assert wrong > 50


def test_memory_is_that_of_the_steps_and_a_tree_for_each_piece(device, rng):
    curves = moving(rng)
    tree = build_bvh(Memory(device), curves)
    assert (tree.motion, tree.vertices.size) == (2, 3 * 16 * curves.n_points)
    read = tree.read()
    assert read.vertices.shape == (curves.n_points, 3, 4)
    assert curves.steps is not None
    for step in range(3):
        assert np.array_equal(read.vertices[:, step, :3], curves.steps[step])
    roots = read.blocks[0, BLOCK_REFERENCES:][:2]
    assert roots[0] == 1 < roots[1] < tree.n_blocks
