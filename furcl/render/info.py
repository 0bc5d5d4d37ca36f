"""Facts about a scene or a groom, for people."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from furcl.fibre.double_cylinder.parameters import RANGES, Fibre
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene


def describe(path: str | Path, overrides: Iterable[str] = ()) -> dict[str, str]:
    """Names and values of what a scene (.toml) or a groom file holds; needs no device.

    What a scene needs of a device is told by `furcl.render.info_device`.

    Raises
    ------
    SceneError, GroomError, ImageError      if the file cannot be used
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return {"groom": str(path), **_describe_curves(load_curves(path))}
    scene = load_scene(path, overrides=overrides)
    film, render = scene.film, scene.render
    fibre = scene.build_fibre()
    return {
        "scene": scene.name,
        "film": f"{film.width} x {film.height}, {film.filter} filter",
        "fibre": _parameters(fibre),
        "fibre's source": fibre.provenance,
        "environment": _describe_environment(scene),
        "render": f"{render.spp} spp, {render.sampling}, at most {render.max_depth} bounces",
        **_describe_curves(scene.build_curves()),
    }


def _parameters(fibre: Fibre) -> str:
    """Every parameter; three equal channels as one number."""
    parts = []
    for name in RANGES:
        channels = np.atleast_1d(getattr(fibre, name)).tolist()
        shown = channels if len(set(channels)) > 1 else channels[:1]
        unit = " deg" if name.endswith("_deg") else ""
        parts.append(f"{name.removesuffix('_deg')} {'/'.join(f'{x:.4g}' for x in shown)}{unit}")
    return ", ".join(parts)


def _describe_environment(scene: Scene) -> str:
    clamped = scene.build_light().n_negative
    found = f", {clamped} pixels below zero set to zero" if clamped else ""
    return f"{scene.environment}{found}"


def _describe_curves(curves: Curves) -> dict[str, str]:
    per_strand = np.diff(curves.offsets)
    lower, upper = curves.bounds()
    lengths = np.linalg.norm(np.diff(curves.points, axis=0), axis=1)[curves.segment_vertices()]
    dropped = ", ".join(f"{count} {name}" for name, count in curves.dropped.items())
    return {
        "strands": f"{curves.n_strands}",
        "points": f"{curves.n_points} ({per_strand.min()} to {per_strand.max()} a strand)",
        "segments": f"{curves.n_segments}",
        "segment length": f"{np.median(lengths):.4g} (median), {lengths.max():.4g} (largest)",
        "radius": f"{curves.radii.min():.4g} to {curves.radii.max():.4g}",
        "bounds": f"{_point(lower)} to {_point(upper)}",
        "memory": f"{curves.n_bytes / 2**20:.1f} MiB on the host",
        "left out on reading": dropped or "nothing",
    }


def _point(p: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in p) + ")"
