"""What makes a picture black or slow, as far as it can be known before it is rendered."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.model import model_of
from furcl.groom.curves import Curves
from furcl.scene.camera import Camera
from furcl.scene.tables import Scene
from furcl.surface.mesh.mesh import Meshes
from furcl.surface.model import Surface

Array = NDArray[np.float64]

POINTS = 100_000  # as many points of a groom are looked at
STRANDS = 1000  # and as many of its strands
FAR_SIZES = 1e5  # there float32 places points within a hundredth of the groom's size
SMALL_PX = 2.0
# Of the groom's size.
FAR_BESIDE = 0.25
THIN_PX = 1e-3
WIDE_LENS = 10.0
DARK = 1e-3  # of the light; the blackest hair reflects 0.04
FEW_HITS = 10
FEW_SEGMENTS = 100_000  # of more, thin ones are told by their thickness
LONG_SPP = 1e11  # samples of all pixels: hours on any machine


def of_scene(scene: Scene, curves: Curves, meshes: Meshes | None = None) -> Iterator[str]:
    """Reasons why the picture may be black, empty, coarse or slow; one sentence each."""
    for name in scene.material.keys() - scene.materials().keys():
        yield f"material {name} is of no groom: no groom names it"
    for name, fibre in scene.build_fibres().items():
        said = (model_of(fibre).warning(fibre), _of_darkness(fibre))
        yield from (f"fibre of {name}: {text}" for text in said if text)
    points = _some(curves)
    camera = scene.resolved_camera(curves, meshes)
    lower, upper = (bound.astype(np.float64) for bound in curves.bounds())
    yield from _of_places(lower, upper, points)
    yield from _of_thickness(curves)
    yield from _of_view(scene, camera, points, curves)
    if scene.body is not None:
        yield from _of_body(scene.body, camera, points)
    if meshes is not None:
        yield from _of_meshes(meshes, lower, upper)
    samples = scene.film.window.n_pixels * scene.render.spp
    if samples > LONG_SPP:
        yield f"{samples:.1g} samples of all pixels take hours or days; reduce spp or the film"


def _of_darkness(fibre: object) -> str | None:
    """Whether a fibre neither reflects light at its surface nor lets it through."""
    eta = getattr(fibre, "eta", None)
    sigma = getattr(fibre, "sigma_a", getattr(fibre, "sigma_ca", None))
    if eta is None or sigma is None:
        return None
    reflected = ((eta - 1.0) / (eta + 1.0)) ** 2
    through = float(np.exp(-2.0 * np.min(sigma)))  # across the middle; both sigmas are per radius
    if reflected + through > DARK:
        return None
    return (
        f"it is black: with eta {eta:.6g} the surface reflects {reflected:.1g} of the light, and "
        f"{through:.1g} goes through; raise eta, or absorb less"
    )


def _some(curves: Curves) -> Array:
    """Points of a groom, at most POINTS of them, spread over it."""
    return curves.points[:: -(-curves.n_points // POINTS)].astype(np.float64)


def _of_places(lower: Array, upper: Array, points: Array) -> Iterator[str]:
    size = float((upper - lower).max())
    distance = float(np.abs([lower, upper]).max())
    if distance > FAR_SIZES * size:
        yield (
            f"the groom is {distance / size:.1g} of its sizes away from the origin: float32 cannot "
            f"tell its points apart; move it to the origin"
        )
    middle = np.percentile(points, (5.0, 95.0), axis=0)
    core = float((middle[1] - middle[0]).max())
    if size > 1e3 * core:
        yield (
            f"nine tenths of its points are within {core:.4g}, all of them within {size:.4g}: are "
            f"there stray points?"
        )


def _of_thickness(curves: Curves) -> Iterator[str]:
    """Whether most strands are thicker than long, as where radii are in other units."""
    strands = np.arange(curves.n_strands)[:: -(-curves.n_strands // STRANDS)]
    ends = curves.offsets.astype(np.int64)
    lengths = [
        np.linalg.norm(np.diff(curves.points[a:b].astype(np.float64), axis=0), axis=1).sum()
        for a, b in zip(ends[strands], ends[strands + 1], strict=True)
    ]
    thick, length = 2.0 * float(np.median(curves.radii)), float(np.median(lengths))
    if thick > 0.5 * length:
        yield (
            f"fibres are {thick:.3g} thick and {length:.3g} long, so that a camera or a ray may "
            f"begin inside of them; are radii in other units? Give radius_scale"
        )


def _of_view(scene: Scene, camera: Camera, points: Array, curves: Curves) -> Iterator[str]:
    x, y, depth = camera.on_film(points, scene.film.aspect)
    in_front = depth > 0.0
    if not in_front.any():
        yield "the groom is behind the camera; turn the camera, or leave origin and target out"
        return
    size = float(np.ptp(points, axis=0).max())
    if camera.aperture_radius > WIDE_LENS * size:
        yield (
            f"the lens is {camera.aperture_radius / size:.1g} times as large as the groom: from "
            f"nearly all of it rays pass the groom; reduce aperture_radius"
        )
    x, y, z = x[in_front], y[in_front], depth[in_front]
    if not ((np.abs(x) < 1.0) & (np.abs(y) < 1.0)).any():
        if x.min() > 1.0 or x.max() < -1.0 or y.min() > 1.0 or y.max() < -1.0:
            yield "the groom is outside the picture; turn the camera, or leave origin out"
            return
        if not _in_picture(scene, camera, curves):
            yield (
                "no strand is in the picture, which looks between them; turn the camera, give a "
                "wider vfov_deg, or leave origin and target out"
            )
            return
    height_px = 0.5 * scene.film.height
    extent = max(float(np.ptp(x)) * scene.film.aspect, float(np.ptp(y))) * height_px
    if extent < SMALL_PX:
        yield f"the groom is {extent:.2g} pixels large in the picture; move the camera closer"
    half = camera.half_height * (1.0 if camera.orthographic else float(np.median(z)))
    radius_px = float(np.median(curves.radii)) / half * height_px
    if radius_px < THIN_PX:
        yield (
            f"fibres are {2.0 * radius_px:.1g} pixels thick: samples hardly meet them, so the "
            f"picture is black or noisy; give radius_scale or move the camera closer"
        )
    elif curves.n_segments <= FEW_SEGMENTS and radius_px < scene.film.height:
        hits = _likely_hits(scene, camera, curves)
        if hits < FEW_HITS:
            yield (
                f"about {hits:.1g} samples of all pixels meet a fibre, so the picture is black or "
                f"noisy; give more samples, radius_scale, or move the camera closer"
            )


def _likely_hits(scene: Scene, camera: Camera, curves: Curves) -> float:
    """How many samples of all pixels meet a fibre where none hides another."""
    x, y, depth = camera.on_film(curves.points.astype(np.float64), scene.film.aspect)
    first = curves.segment_vertices()
    in_front = (depth[first] > 0.0) & (depth[first + 1] > 0.0)
    film, first = np.stack([x, y], 1), first[in_front]
    a, b = film[first], film[first + 1]
    begin, end = _between_sides(a, b, 1.0)
    share = np.maximum(np.minimum(end, 1.0) - np.maximum(begin, 0.0), 0.0)
    half_px = 0.5 * np.array([scene.film.width, scene.film.height])
    length_px = np.linalg.norm((b - a) * half_px, axis=1) * share
    half = camera.half_height * (1.0 if camera.orthographic else depth[first])
    thick_px = 2.0 * curves.radii[first] / half * half_px[1]
    return float((length_px * thick_px).sum() * scene.render.spp)


def _in_picture(scene: Scene, camera: Camera, curves: Curves) -> bool:
    """Whether a segment is, with its radius, partly in the picture; yes if some are partly behind
    the camera."""
    x, y, depth = camera.on_film(curves.points.astype(np.float64), scene.film.aspect)
    first = curves.segment_vertices()
    a, b = np.stack([x, y], 1)[first], np.stack([x, y], 1)[first + 1]
    front = depth > 0.0
    if (front[first] != front[first + 1]).any():
        return True
    half = camera.half_height * (1.0 if camera.orthographic else float(depth[front].min()))
    margin = 1.0 + float(curves.radii.max()) / max(half, 1e-30) * max(1.0, 1.0 / scene.film.aspect)
    begin, end = _between_sides(a, b, margin)
    return bool((front[first] & (np.maximum(begin, 0.0) <= np.minimum(end, 1.0))).any())


def _between_sides(a: Array, b: Array, margin: float) -> tuple[Array, Array]:
    """From which to which part of the way from a to b, (m, 2) on the film, it is between both
    sides along both axes, (m,) each; they may lie beyond 0 and 1, and in the other order."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack([(-margin - a) / (b - a), (margin - a) / (b - a)]), axis=0)
    still = (a == b) & (np.abs(a) <= margin)
    begin = np.where(still, -np.inf, ends[0]).max(axis=1)
    return begin, np.where(still, np.inf, ends[1]).min(axis=1)


def _of_body(body: Surface, camera: Camera, points: Array) -> Iterator[str]:
    if body.contains(np.array([camera.origin])).any():
        yield "the camera is inside the body, which stops all light; move one of them"
    if body.contains(points).all():
        yield "the whole groom is inside the body, which hides it; make the body smaller"


def _of_meshes(meshes: Meshes, lower: Array, upper: Array) -> Iterator[str]:
    """A mesh in other units, or with another axis up, stands far beside the groom; a floor lies
    close to it."""
    points = meshes.points()
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    gap = float(np.maximum(low - upper, lower - high).max())
    if gap > FAR_BESIDE * float((upper - lower).max()):
        yield (
            "the meshes and the groom are beside each other: have they other units, or another "
            "axis that is up? Give the mesh a transform"
        )
