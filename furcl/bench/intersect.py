"""`furcl bench intersect`: rays a second, furcl beside Embree on the same rays."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.ray_sets import RaySet, ray_sets
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.device.layout import NO_SEGMENT
from furcl.errors import GroomError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves
from furcl.groom.grow import GENERATORS
from furcl.oracle.embree_rays import EmbreeScene
from furcl.rendering.rays import Rays, Tracer
from furcl.scene.camera import Camera
from furcl.scene.read import find_scene, load_scene
from furcl.surface.mesh.mesh import Meshes

# Distances that differ by no more than this part are one hit (joints are hit twice at one place).
TOLERANCE = 1e-4

# Points of a strand, and what its radius is over the root of the number of strands: so any number
# of them covers the same, and more strands are thinner ones.
GENERATED = {"hair": (16, 0.18), "fur": (8, 0.47)}

# Strands of `head`, about as many as people have: more segments are shorter ones.
HEAD_STRANDS = 100_000
HEAD_LEAST_SEGMENTS = 6  # of a strand, for its wave


def groom_and_camera(name: str) -> tuple[Curves, Camera]:
    """The groom that a name stands for, and a camera that sees it.

    name is a scene (.toml), a groom file, or `hair:N`, `fur:N` or `head:N`: about N generated
    segments. Strands of hair and fur have the same number of points for every N and get thinner;
    heads have the same strands for every N, which get more points.

    Raises
    ------
    SceneError, GroomError      if the file cannot be used or the name says nothing
    """
    kind, colon, count = name.partition(":")
    generated = colon and kind in (*GENERATED, "head")
    path = find_scene(name)
    if not generated and path.suffix.lower() == ".toml":
        scene = load_scene(path)
        curves = scene.build_curves()
        return curves, scene.resolved_camera(curves)
    curves = _generate(kind, count) if generated else load_curves(path)
    return curves, Camera().resolved(curves.points, 1.0, float(curves.radii.max()))


def meshes_of(name: str) -> Meshes | None:
    """The meshes of the scene that a name stands for; None where it is no scene or has none.

    Raises
    ------
    SceneError, MeshError, ImageError       if a file cannot be used
    """
    path = find_scene(name)
    if path.suffix.lower() != ".toml":
        return None
    return load_scene(path).build_meshes()


def _generate(kind: str, count: str) -> Curves:
    """The groom `kind:count`."""
    if not count.isdecimal():
        raise GroomError(
            f"{kind}:{count}: {count!r} is not a number of segments; try {kind}:1000000"
        )
    generator = "hair" if kind == "head" else kind
    n_points, radius = GENERATED[generator]
    n_strands = max(1, int(count) // (n_points - 1))
    if kind == "head":
        n_strands, n_points = HEAD_STRANDS, int(count) // HEAD_STRANDS + 1
        if n_points <= HEAD_LEAST_SEGMENTS:
            raise GroomError(
                f"head:{count}: {HEAD_STRANDS} strands that wave have at least "
                f"{HEAD_LEAST_SEGMENTS * HEAD_STRANDS} segments; try head:1000000, or hair:{count}"
            )
    return GENERATORS[generator](
        n_strands=n_strands, n_points=n_points, radius=radius / np.sqrt(n_strands)
    )


def run(
    groom: str,
    out: str | os.PathLike[str],
    *,
    device: str | Device | None = None,
    size: int = 512,
    rounds: int = 5,
    seed: int = 1,
) -> dict[str, Any]:
    """Trace the same rays by furcl and by Embree (flat linear curves, and the triangles of a
    scene's meshes; all cores), in turns.

    Parameters
    ----------
    groom : str         see groom_and_camera
    out : path          folder for results.json
    size : int          width and height of the picture that the primary rays make [px]
    rounds : int        times that both are measured, furcl and Embree alternately

    Returns
    -------
    dict    `rays`: per kind of ray the number, the share that hits, million rays a second of both
            (medians), `ratio` (median of the rounds' ratios), `cpu_ratio` (of processor seconds:
            steadier on a machine that others use; None on GPUs) and `disagreements`, the share of
            rays on which the two find different things; build times and memory [bytes]: the
            groom, the tree on the device, most on the device while it was built, most in the
            process before and after the groom was made and its tree built (CPU runtimes keep the
            device's buffers in the process)

    Raises
    ------
    SceneError, GroomError, DeviceError, BvhError, KernelBuildError, ResourceError
    """
    opened = device if isinstance(device, Device) else open_device(device)
    for point_radii in (False, True):  # compiles all kernels, or loads what was compiled
        Tracer(opened, GENERATORS["fur"](n_strands=1000), point_radii)
    host_start = _host_peak()
    curves, camera = groom_and_camera(groom)
    meshes = meshes_of(groom)
    corners = None if meshes is None else meshes.corners()
    if corners is not None:
        Tracer(opened, GENERATORS["fur"](n_strands=1000), not curves.one_radius, corners[:1])
    start_cpu = time.process_time()
    tracer = Tracer(opened, curves, not curves.one_radius, corners)
    build_cpu = time.process_time() - start_cpu
    bvh, host_peak = tracer.bvh, _host_peak()
    start = time.perf_counter()
    scene = EmbreeScene(curves, corners)
    embree_seconds = time.perf_counter() - start
    results = {
        **circumstances(opened),
        "groom": groom,
        "strands": curves.n_strands,
        "segments": curves.n_segments,
        "triangles": 0 if corners is None else len(corners),
        "bytes_per_segment": bvh.n_bytes / curves.n_segments,
        "build_seconds": bvh.build_seconds,
        "build_cpu_seconds": build_cpu if opened.is_cpu else None,
        "groom_bytes": curves.n_bytes,
        "build_bytes": {
            "device": bvh.n_bytes,
            "device_peak": tracer.memory.peak_bytes,
            "host_start": host_start,
            "host_peak": host_peak,
        },
        "embree_build_seconds": embree_seconds,
        "rounds": rounds,
        "rays": [
            _measure(tracer, scene, rays, rounds)
            for rays in ray_sets(curves, camera, size, scene, seed, corners)
        ],
    }
    write_json(results, Path(out) / "results.json")
    return results


def _measure(tracer: Tracer, scene: EmbreeScene, rays: RaySet, rounds: int) -> dict[str, Any]:
    on_device = Rays(
        tracer.memory, rays.origins[:, :3], rays.directions[:, :3], rays.directions[:, 3]
    )
    if rays.any_hit:
        ours, theirs = tracer.shadow, scene.occluded
        found = {"ours": tracer.occluded, "theirs": scene.occluded}
    else:
        ours, theirs = tracer.closest, scene.intersect
        found = {"ours": tracer.hits, "theirs": scene.intersect}
    ours(on_device).wait()
    mine = found["ours"](on_device)
    other = found["theirs"](rays.origins, rays.directions)
    times = np.array(
        [
            (
                *_timed(lambda: ours(on_device).wait()),
                *_timed(lambda: theirs(rays.origins, rays.directions)),
            )
            for _ in range(rounds)
        ]
    )
    n = on_device.n
    wall, cpu, embree_wall, embree_cpu = times.T
    return {
        "kind": rays.name,
        "n": n,
        "hit": float(np.mean(mine if rays.any_hit else mine[1] != NO_SEGMENT)),
        "mrays_s": n / float(np.median(wall)) / 1e6,
        "embree_mrays_s": n / float(np.median(embree_wall)) / 1e6,
        "ratio": float(np.median(embree_wall / wall)),
        "cpu_ratio": float(np.median(embree_cpu / cpu)) if tracer.device.is_cpu else None,
        "disagreements": _disagreements(mine, other, rays.any_hit),
    }


def _host_peak() -> int:
    """Most memory that the process has held [bytes]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def _timed(action: Callable[[], Any]) -> tuple[float, float]:
    """Wall and processor seconds of an action."""
    start, start_cpu = time.perf_counter(), time.process_time()
    action()
    return time.perf_counter() - start, time.process_time() - start_cpu


def _disagreements(ours, theirs, any_hit: bool) -> float:
    """Share of rays with another verdict, or neither the same segment nor the same distance."""
    if any_hit:
        return float(np.mean(ours != theirs))
    (t, segment, _), (t_embree, segment_embree, _) = ours, theirs
    both = (segment != NO_SEGMENT) & (segment_embree != NO_SEGMENT)
    near = both & (np.abs(t - t_embree) <= TOLERANCE * np.abs(t_embree))
    return float(np.mean(~((segment == segment_embree) | near)))
