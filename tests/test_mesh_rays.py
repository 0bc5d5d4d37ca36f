"""Rays against triangles: beside float64, beside Embree, through closed meshes."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_mutants import substitute
from mesh_shapes import box, nearest, soup, sphere
from ray_reference import random_directions, random_walks, strands, unit

from furcl.bvh.build import build_bvh
from furcl.device.layout import NO_SEGMENT, TRIANGLE
from furcl.device.memory import Memory
from furcl.groom.curves import Curves
from furcl.oracle.embree_rays import EmbreeScene
from furcl.rendering.rays import Rays, Tracer
from furcl.surface.mesh.read import read_mesh
from furcl.surface.mesh.triangles import Triangles


def far_groom():
    """A strand that no ray meets."""
    return random_walks(np.random.default_rng(0), 1, 2, 1e-3, 1e-6)


def trace(device, corners, origins, directions, t_max=np.inf, curves=None, from_segment=None):
    tracer = Tracer(device, curves or far_groom(), corners=corners)
    rays = Rays(tracer.memory, origins, directions, t_max, from_segment)
    tracer.closest(rays)
    t, name, _ = tracer.hits(rays)
    tracer.shadow(rays)
    assert np.array_equal(tracer.occluded(rays), name != NO_SEGMENT)
    return t, name


def triangle_of(name):
    """Numbers of triangles, -1 where there is none."""
    hit = (name >= TRIANGLE) & (name < NO_SEGMENT - 4)
    return np.where(hit, (name.astype(np.int64) - TRIANGLE) // 3, -1)


def rays_at(rng, corners, n):
    points = corners.reshape(-1, 3)
    lo, hi = points.min(axis=0), points.max(axis=0)
    target = lo + rng.random((n, 3)) * (hi - lo)
    origins = target - unit(rng.standard_normal((n, 3))) * np.linalg.norm(hi - lo) * rng.random(
        (n, 1)
    )
    return origins.astype(np.float32), unit(target - origins).astype(np.float32)


@pytest.mark.parametrize("n", [1, 2, 9, 700])
def test_hits_are_those_of_float64(device, n, rng):
    """Measured: no difference in 4000 rays beyond the margin."""
    corners = soup(rng, n).corners
    origins, d = rays_at(rng, corners, 4000)
    t, name = trace(device, corners, origins, d)
    expected_t, expected, margin = nearest(corners, origins, d)
    sure = margin > 1e-4
    assert sure.mean() > 0.5
    assert np.array_equal(triangle_of(name)[sure], expected[sure])
    both = sure & (expected >= 0)
    assert both.sum() > 20
    assert np.abs(t[both] / expected_t[both] - 1.0).max() < 1e-4


def through(rng, triangles, n):
    """Rays from inside a ball of radius 0.5 through its edges and corners, and at random."""
    c = triangles.corners
    which = rng.integers(0, len(c), n)
    share = rng.random((n, 1)).astype(np.float32)
    edge = c[which, 0] * share + c[which, 1] * (1 - share)
    goal = np.where((np.arange(n) % 3 == 0)[:, None], c[which, 2], edge)
    goal = np.where((np.arange(n) % 3 == 1)[:, None], rng.standard_normal((n, 3)), goal)
    origins = (0.3 * unit(rng.standard_normal((n, 3)))).astype(np.float32)
    return origins, unit(goal - origins).astype(np.float32)


@pytest.mark.parametrize("repeats", [1, pytest.param(34, marks=pytest.mark.slow)])
@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_closed_meshes_leak_nothing(device, offset, repeats, rng):
    """300,000 rays, or 10^7: a third aim at edges, a third at corners."""
    triangles = sphere(24)
    corners = triangles.corners + np.float32(offset)
    for _ in range(repeats):
        origins, d = through(rng, triangles, 300_000)
        _, name = trace(device, corners, origins + np.float32(offset), d)
        assert (name != NO_SEGMENT).all()


def below_a_lid(rng, depth, n=4000):
    """Rays from the axes of fibres of radius 0.01, at a depth below the lid of a flat box."""
    middle = np.column_stack([rng.uniform(-5.0, 5.0, (n, 2)), np.full(n, -depth)])
    along = 0.05 * unit(np.column_stack([rng.standard_normal((n, 2)), np.zeros(n)]))
    curves = strands(np.stack([middle - along, middle + along], axis=1), 0.01)
    d = random_directions(rng, n)
    return middle.astype(np.float32), d[np.abs(d[:, 2]) > 0.12], curves


def lid_hits(device, rng, depth):
    origins, d, curves = below_a_lid(rng, depth)
    segment = 2 * np.arange(len(origins), dtype=np.uint32)[: len(d)]
    corners = box((-10.0, -10.0, -0.1), (10.0, 10.0, 0.0))
    t, name = trace(device, corners, origins[: len(d)], d, curves=curves, from_segment=segment)
    return d[:, 2] > 0.0, t, triangle_of(name), name == NO_SEGMENT


@pytest.mark.parametrize("depth", [0.0001, 0.01, 0.019])
def test_a_fibre_just_below_a_surface_is_above_it(device, depth, rng):
    """Outwards rays go free or meet other fibres, inwards they are stopped where they begin."""
    up, t, triangle, nothing = lid_hits(device, rng, depth)
    assert (triangle[up] == -1).all()
    assert nothing[up].mean() > 0.5
    assert (triangle[~up] >= 0).all()
    assert (t[~up] < 1e-20).all()


def test_a_fibre_deep_below_a_surface_is_below_it(device, rng):
    up, t, triangle, _ = lid_hits(device, rng, 0.03)
    met = up & (triangle >= 0)
    assert met.mean() > 0.3
    assert (t[met] > 0.029).all()
    assert (t[~up & (triangle >= 0)] > 0.06).all()


MUTANTS = {
    "rays see what they are below": (r"query->reach > 0\.0f && depth >= 0\.0f", "false"),
    "rays inwards go through": (r"hit->t = fmax\(hit->t, 1e-30f\);", "return hit->t > 0.0f;"),
    "nothing is looked for behind the start": (r"REACHES_BEHIND 8\.0f", "REACHES_BEHIND 0.0f"),
    "fronts are free": (r"hit->facing > 0\.0f\) return false", "hit->facing < 0.0f) return false"),
}


@pytest.mark.parametrize("mutant", MUTANTS)
def test_mutants_of_the_rule_are_seen(device, rng, monkeypatch, mutant):
    substitute(monkeypatch, *MUTANTS[mutant], within="tools/trace_rays.cl")
    up, t, triangle, _ = lid_hits(device, rng, 0.01)
    assert (triangle[up] >= 0).any() or (t[~up] > 1e-20).any()


def test_a_triangle_is_not_met_by_the_ray_that_leaves_it(device, rng):
    """Its neighbours are, and all else."""
    corners = soup(rng, 300).corners
    which = rng.integers(0, len(corners), 3000)
    share = rng.dirichlet(np.ones(3), 3000).astype(np.float32)
    origins = (share[:, :, None] * corners[which]).sum(axis=1).astype(np.float32)
    d = random_directions(rng, 3000)
    left = (TRIANGLE + 3 * which).astype(np.uint32)
    _, name = trace(device, corners, origins, d, from_segment=left)
    assert (name != left).all()
    assert (name != NO_SEGMENT).mean() > 0.05


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_rays_that_are_not_finite_end(device, value, rng):
    corners = soup(rng, 300).corners
    origins, d = rays_at(rng, corners, 64)
    d[::2, 1] = value
    origins[1::4, 2] = value
    _, name = trace(device, corners, origins, d)
    assert (name[::2] == NO_SEGMENT).all()


def test_edges_that_are_decided_with_rounding_leak(device, rng, monkeypatch):
    """The mutant of the test of closed meshes. Measured: 370 of 300 000 rays."""
    pattern = r"return fma\(a, b, -cd\) \+ lost;"
    substitute(monkeypatch, pattern, "return a * b - cd;", within="tools/trace_rays.cl")
    triangles = sphere(24)
    origins, d = through(rng, triangles, 300_000)
    _, name = trace(device, triangles.corners, origins, d)
    assert (name == NO_SEGMENT).any()


@pytest.mark.parametrize("fibres", ["far away", "among them"])
def test_hits_are_those_of_embree(device, fibres, rng):
    """Triangles and curves in one scene. Measured: none disagrees."""
    corners = np.concatenate([sphere(24).corners, soup(rng, 3000).corners])
    curves = far_groom() if fibres == "far away" else random_walks(rng, 2000, 10, 0.05, 2e-3)
    origins, d = rays_at(rng, corners, 100_000)
    t, name = trace(device, corners, origins, d, curves=curves)
    far = np.full((len(d), 1), np.float32(1e30))
    t_ref, name_ref, _ = EmbreeScene(curves, corners).intersect(
        np.column_stack([origins, far]), np.column_stack([d, far])
    )
    both = (name != NO_SEGMENT) & (name_ref != NO_SEGMENT)
    with np.errstate(invalid="ignore", over="ignore"):
        near = both & (np.abs(t - t_ref) <= 1e-4 * np.abs(t_ref))
    differ = np.mean(~((name == name_ref) | near))
    assert (triangle_of(name) >= 0).mean() > 0.2
    assert ((name < TRIANGLE).mean() > 0.02) == (fibres == "among them")
    assert differ < 1e-3


def both_and_each(device, rng, pieces, chunk_segments):
    """Rays at any times among a groom that moves over so many pieces of time (0: keeps still) and
    triangles; distances, names and whether anything is hit, each (3, n), among both, the groom
    alone, triangles alone."""
    walks = random_walks(rng, 300, 10, 0.2, 0.01)
    steps = np.stack([walks.points + np.float32(0.1 * i) for i in range(pieces + 1)])
    times = np.arange(pieces + 1.0) if pieces else None
    points = steps if pieces else walks.points
    curves = Curves.from_arrays(points, walks.radii, walks.offsets, times=times)
    corners = soup(rng, 300).corners
    origins, d = rays_at(rng, corners, 6000)
    moments = rng.uniform(0.0, max(pieces, 1), len(d)).astype(np.float32)
    found = []
    for groom, triangles in ((curves, corners), (curves, None), (far_groom(), corners)):
        tracer = Tracer(device, groom, corners=triangles)
        if groom is curves:
            memory = Memory(device)
            tree = build_bvh(memory, groom, corners=triangles, chunk_segments=chunk_segments)
            tracer.geometry = tree.arguments()
        rays = Rays(tracer.memory, origins, d, times=moments)
        tracer.closest(rays)
        t, name, _ = tracer.hits(rays)
        tracer.shadow(rays)
        found.append((t, name, tracer.occluded(rays)))
    t, name, occluded = (np.array(values) for values in zip(*found, strict=True))
    return t, name, occluded


@pytest.mark.parametrize("chunk_segments", [1 << 20, 400])
@pytest.mark.parametrize("pieces", [0, 1, 11])
def test_both_trees_are_searched_at_every_time(device, pieces, chunk_segments, rng):
    """The nearer hit of the two, to the bit; 11 pieces have their roots in two blocks."""
    t, name, occluded = both_and_each(device, rng, pieces, chunk_segments)
    nearer = np.where(t[1] <= t[2], 1, 2)
    expected_t, expected = (np.take_along_axis(a, nearer[None], axis=0)[0] for a in (t, name))
    assert np.array_equal(t[0], expected_t)
    assert np.array_equal(name[0], expected)
    assert np.array_equal(occluded, name != NO_SEGMENT)
    assert (name[0] < TRIANGLE).mean() > 0.05
    assert (triangle_of(name[0]) >= 0).mean() > 0.05


@pytest.mark.parametrize(
    ("pattern", "text", "nearest_hits", "any_hits"),
    [
        (r"piece % FURCL_BVH_WIDTH", "0u", True, True),
        (r"piece / FURCL_BVH_WIDTH", "0u", True, True),
        (r"tv->next = joint;", "tv->next = FURCL_NO_BLOCK;", True, False),
        (
            r"tv->next = groom->blocks\[FURCL_BLOCK_ORIGIN\]",
            "tv->next = FURCL_NO_BLOCK",
            False,
            True,
        ),
        (r"tv->top = stack_push_root\(.*;", "", False, True),
    ],
)
def test_a_tree_that_is_not_searched_is_missed(
    device, monkeypatch, pattern, text, nearest_hits, any_hits
):
    t, _, occluded = both_and_each(device, np.random.default_rng(3), 11, 1 << 20)
    substitute(monkeypatch, pattern, text, within="tools/trace_rays.cl")
    wrong, _, missed = both_and_each(device, np.random.default_rng(3), 11, 1 << 20)
    assert ((wrong[0] > np.minimum(t[1], t[2])).mean() > 0.01) == nearest_hits
    assert ((occluded[0] & ~missed[0]).mean() > 0.01) == any_hits


@pytest.mark.parametrize(("mesh", "scale"), [("sintel_head.obj", 1.0), ("bunny.ply", 10.0)])
def test_hits_on_real_meshes_are_those_of_embree(device, mesh, scale, shared_data, rng):
    found = read_mesh(shared_data / "mesh" / mesh)
    corners = Triangles.from_arrays(scale * found.vertices, found.faces).corners
    origins, d = rays_at(rng, corners, 50_000)
    t, name = trace(device, corners, origins, d)
    far = np.full((len(d), 1), np.float32(1e30))
    t_ref, name_ref, _ = EmbreeScene(far_groom(), corners).intersect(
        np.column_stack([origins, far]), np.column_stack([d, far])
    )
    both = (name != NO_SEGMENT) & (name_ref != NO_SEGMENT)
    with np.errstate(invalid="ignore", over="ignore"):
        near = both & (np.abs(t - t_ref) <= 1e-4 * np.abs(t_ref))
    assert both.mean() > 0.2
    assert np.mean(~((name == name_ref) | near)) < 1e-3
