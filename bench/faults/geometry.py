"""Grooms that are legal and cost, or looked, as they should not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faults.case import Case
from furcl.bench.ray_counts import RayCounts, count_rays
from furcl.bvh.build import CHUNK_SEGMENTS, build_bvh
from furcl.device.choice import open_device
from furcl.device.memory import Memory
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves
from furcl.rendering.rays import Rays, Tracer
from furcl.rendering.renderer import render
from furcl.scene.read import decode_scene
from furcl.scene.tables import Scene

Array = NDArray[np.float64]

#: Where the real grooms are, beside the repository.
SHARED = Path(__file__).parents[3] / "shared" / "data" / "hair"
RADIUS = 0.01
MOST_BLOCKS = 1.1  # blocks that rays may look at, beside those of the groom without the fault
MOST_LIGHT = 0.003  # of the mean, by which a curve and the same in short strands may differ


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def walks(rng: np.random.Generator, n: int, k: int) -> Curves:
    """Strands of k points from places in the unit cube, each turning at random."""
    direction, points = unit(rng.standard_normal((n, 3))), [rng.random((n, 3))]
    for _ in range(k - 1):
        direction = unit(direction + 0.5 * rng.standard_normal((n, 3)))
        points.append(points[-1] + 0.05 * direction)
    return Curves.from_arrays(np.stack(points, axis=1), 0.002)


def rays_near(rng: np.random.Generator, curves: Curves, n: int) -> tuple[NDArray, NDArray]:
    """Origins and directions of rays through places of a groom, half from inside it."""
    lo, hi = np.quantile(curves.points, [0.001, 0.999], axis=0)
    target = lo + rng.random((n, 3)) * (hi - lo)
    back = np.where(np.arange(n) % 2, 0.0, 1.0)[:, None] * (hi - lo).max()
    way = unit(rng.standard_normal((n, 3)))
    return (target - back * way).astype(np.float32), way.astype(np.float32)


def counts_of(
    curves: Curves,
    origins: NDArray,
    directions: NDArray,
    from_segment: NDArray[np.uint32] | None = None,
    chunk_segments: int = CHUNK_SEGMENTS,
) -> RayCounts:
    """What rays cost in the tree of a groom that is built in chunks of so many segments."""
    tracer = Tracer(open_device(), curves)
    if chunk_segments < curves.n_segments:
        chunked = build_bvh(Memory(tracer.device), curves, chunk_segments=chunk_segments)
        tracer.geometry = chunked.arguments()
    return count_rays(tracer, Rays(tracer.memory, origins, directions, np.inf, from_segment))


def moved(curves: Curves, vertices: slice, distance: float) -> Curves:
    points = curves.points.copy()
    points[vertices] += np.float32(distance) * np.array([0.6, 0.64, 0.48], np.float32)
    return Curves.from_arrays(points, curves.radii, curves.offsets)


#: A point within a strand, the last one of a strand, a whole strand; of ten points each.
STRAY = {"a point": slice(205, 206), "a last point": slice(209, 210), "a strand": slice(200, 210)}


def blocks_beside_stray(
    curves: Curves,
    stray: Mapping[str, slice],
    distances: Sequence[float],
    chunk_segments: int = CHUNK_SEGMENTS,
) -> str:
    """Blocks that rays look at with points far away over those without."""
    rng = np.random.default_rng(1)
    rays = rays_near(rng, curves, 4000)
    usual = counts_of(curves, *rays, chunk_segments=chunk_segments).blocks.mean()
    ratios = {}
    for name, points in stray.items():
        for distance in distances:
            changed = moved(curves, points, distance)
            counts = counts_of(changed, *rays, chunk_segments=chunk_segments)
            ratios[f"{name} {distance:g} away"] = counts.blocks.mean() / usual
    worst = max(ratios, key=lambda key: ratios[key])
    assert ratios[worst] <= MOST_BLOCKS, f"{ratios[worst]:.2f} times the blocks, {worst}"
    return f"at most {ratios[worst]:.3f} times the {usual:.1f} blocks a ray, {worst}"


def stray_point(folder: Path, quick: bool) -> str:
    curves = walks(np.random.default_rng(1), 5000, 10)
    near = (1.0, 2.0, 2.5, 3.0, 5.0, 10.0)
    distances = (2.5, 1e6) if quick else (*near, 1e2, 1e3, 1e4, 1e5, 1e6)
    return blocks_beside_stray(curves, STRAY, distances)


def stray_point_of_a_large_groom(folder: Path, quick: bool) -> str:
    """More segments than are built at once: chunks below a top of boxes."""
    if quick:
        curves = walks(np.random.default_rng(1), 20_000, 10)
        return blocks_beside_stray(curves, STRAY, (3.0, 1e6), chunk_segments=25_000)
    curves = walks(np.random.default_rng(1), 200_000, 10)
    return blocks_beside_stray(curves, STRAY, (2.0, 3.0, 5.0, 10.0, 1e3, 1e6))


def stray_point_of_a_real_groom(folder: Path, quick: bool) -> str:
    path = SHARED / "sintel_straight.hair"
    if quick or not path.exists():
        return "at full size only, and beside the shared grooms"
    return blocks_beside_stray(load_curves(path), {"a point": slice(11_208, 11_209)}, (1e3,))


def far_from_the_origin(folder: Path, quick: bool) -> str:
    """The same points, on the grid that float32 has there, at the origin and 10^6 away."""
    rng = np.random.default_rng(1)
    there = walks(rng, 1000 if quick else 5000, 10).points + np.float32(1e6)
    offsets = np.arange(0, len(there) + 1, 10)
    near, far = (
        Curves.from_arrays(there - np.float32(shift), 0.002, offsets) for shift in (1e6, 0.0)
    )
    origins, directions = rays_near(rng, near, 4000)
    origins = np.round(origins * 16) / np.float32(16)
    usual = counts_of(near, origins, directions).blocks.mean()
    ratio = counts_of(far, origins + np.float32(1e6), directions).blocks.mean() / usual
    assert ratio <= MOST_BLOCKS, f"{ratio:.2f} times the blocks"
    return f"{ratio:.3f} times the {usual:.1f} blocks a ray"


def long_strand(folder: Path, quick: bool) -> str:
    """A yarn in one strand and in strands of 100 points: rays from it, and its picture."""
    n, rng = 16_000 if quick else 1_000_000, np.random.default_rng(1)
    t = np.linspace(0.0, 0.01 * n, n)
    yarn = np.stack([np.sin(t), np.sin(1.3 * t + 1.0), np.cos(0.7 * t)], axis=1)
    yarn *= 1.0 + 0.2 * np.sin(0.0137 * t)[:, None]
    radius = 0.5 / np.sqrt(n)
    joined = Curves.from_arrays(yarn, radius, [0, n])
    cut = Curves.from_arrays(yarn, radius, np.arange(0, n + 1, 100))
    segment = rng.choice(cut.segment_vertices(), 4000).astype(np.uint32)
    origins = 0.5 * (joined.points[segment] + joined.points[segment + 1])
    directions = unit(rng.standard_normal(origins.shape)).astype(np.float32)
    one, many = (counts_of(c, origins, directions, segment) for c in (joined, cut))
    ratio = one.segments.mean() / many.segments.mean()
    steps = one.left.mean()
    assert 0.9 < ratio < 1.1, f"{ratio:.3f} times the tests of segments"
    assert steps < 3.0, f"{steps:.2f} segments of its own strand looked at a ray"
    more, error = difference(even_light(48, 16 if quick else 64), joined, cut)
    assert abs(more) <= MOST_LIGHT + 3.0 * error, f"{more:+.2%} of light"
    return (
        f"{ratio:.3f} times the tests of segments, {steps:.2f} steps a ray along the strand, "
        f"{more:+.3%} of light"
    )


def even_light(size: int, spp: int, **fibre: float) -> Scene:
    return decode_scene(
        {
            "camera": {"azimuth_deg": 20.0, "elevation_deg": 15.0},
            "film": {"width": size, "height": size},
            "fibre": {"preset": "human-black", "kappa": 0.0, "sigma_ca": 0.05, **fibre},
            "environment": {"kind": "constant"},
            "curves": {"generator": "fibre"},
            "render": {"spp": spp, "max_depth": 64},
        }
    )


def difference(scene: Scene, one: Curves, other: Curves) -> tuple[float, float]:
    """How much more light the first returns, over that of the other, and its standard error.

    Pixels that see the light alone do not count; the same random numbers make the difference of
    a pixel much more certain than its value.
    """
    first, second = (render(scene, curves=c).rgb.astype(np.float64).mean(-1) for c in (one, other))
    seen = np.abs(second - 1.0) > 1e-6
    change, mean = (first - second)[seen], second[seen].mean()
    return change.mean() / mean, change.std() / np.sqrt(len(change)) / mean


def strands_of(parts: Sequence[Array]) -> Curves:
    return Curves.from_arrays(np.concatenate(parts), RADIUS, np.cumsum([0, *map(len, parts)]))


def returning(apart: float) -> tuple[Curves, Curves]:
    """24 strands that return `apart` radii beside themselves; the same with arms and bends cut."""
    half, pitch, along = 0.5 * apart * RADIUS, 2.0 * apart * RADIUS, np.linspace(0.0, 3.0, 25)
    angle, whole, cut = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 17), [], []
    for x, y in ((pitch * i, 0.5 * pitch * row) for row in range(4) for i in range(6)):
        one, other = (
            np.stack([np.full(25, x + side), np.full(25, y), along], axis=1)
            for side in (-half, half)
        )
        bend = [x + half * np.sin(angle), np.full(17, y), 3.0 + half * np.cos(angle)]
        parts = [one, np.stack(bend, axis=1), other[::-1]]
        whole.append(np.concatenate(parts))
        cut += parts
    return strands_of(whole), strands_of(cut)


def coil(pitch: float) -> tuple[Curves, Curves]:
    """12 turns, `pitch` radii apart, of 50 radii; the same with every turn cut."""
    t = np.linspace(0.0, 24.0 * np.pi, 12 * 96 + 1)
    points = np.stack([0.5 * np.cos(t), 0.5 * np.sin(t), pitch * RADIUS * t / (2 * np.pi)], axis=1)
    return strands_of([points]), strands_of([points[96 * i : 96 * i + 97] for i in range(12)])


def light_of_a_strand_beside_itself(folder: Path, quick: bool) -> str:
    """The ends of cut strands take a little light: up to 0.2 % of it here."""
    scene, found = even_light(48, 64 if quick else 1024), {}
    for make in (returning, coil):
        for apart in (2.05,) if quick else (2.05, 2.2, 2.5, 3.0, 4.0):
            more, error = difference(scene, *make(apart))
            found[f"{make.__name__} {apart}"] = more
            assert abs(more) + error <= MOST_LIGHT, f"{make.__name__} {apart}: {more:+.2%}"
    worst = max(found, key=lambda key: abs(found[key]))
    return f"at most {found[worst]:+.3%} of light more, {worst} radii apart"


def doubled_points(folder: Path, quick: bool) -> str:
    """Fur and a thick strand with copies of their points beside them: the same bits of pictures."""
    rng = np.random.default_rng(1)
    fur = walks(rng, 2000, 6).points.reshape(-1, 6, 3)
    radii = np.broadcast_to(np.linspace(0.002, 0.0005, 6), fur.shape[:2])
    thick = np.array([[[0.0, 0, -1], [0, 0, 0], [0, 0, 1]]])
    done = []
    for points, radius, distance in (
        (fur, radii, 1e-6), (thick, 0.15, 1e-8), (thick, 0.15, 1e-17),
    ):  # fmt: skip
        again = points + distance * unit(rng.standard_normal(points.shape))
        both = np.stack([points, again], axis=2).reshape(len(points), -1, 3)
        wide = np.broadcast_to(radius, points.shape[:2])
        scene = even_light(24, 4 if quick else 64)
        plain = render(scene, curves=Curves.from_arrays(points, wide)).rgb
        with_copies = Curves.from_arrays(both, np.repeat(wide, 2, axis=1))
        assert np.array_equal(render(scene, curves=with_copies).rgb, plain), f"{distance} away"
        done.append(f"{sum(with_copies.traced().dropped.values())} of {both.size // 3}")
    return f"left out of the points: {', '.join(done)}; the pictures are the same"


def merged_with_itself(folder: Path, quick: bool) -> str:
    curves = walks(np.random.default_rng(1), 500 if quick else 5000, 8)
    twice = Curves.from_arrays(
        np.tile(curves.points, (2, 1)),
        np.tile(curves.radii, 2),
        np.append(curves.offsets, curves.offsets[1:] + curves.n_points),
    )
    scene = even_light(24 if quick else 64, 4 if quick else 32)
    once, merged = (render(scene, curves=c).rgb for c in (curves, twice))
    assert np.array_equal(once, merged), f"{merged.mean() / once.mean() - 1.0:+.2%} of light"
    return f"{dict(twice.traced().dropped)}; the same picture"


CASES = [
    Case("one stray point slows all rays", stray_point),
    Case("one stray point of a large groom", stray_point_of_a_large_groom),
    Case("one stray point of a real groom", stray_point_of_a_real_groom),
    Case("a groom far from the origin", far_from_the_origin),
    Case("a long strand costs by its points", long_strand),
    Case("copies of points paint discs", doubled_points),
    Case("light leaks through a strand beside itself", light_of_a_strand_beside_itself),
    Case("a groom merged with itself is darker", merged_with_itself),
]
