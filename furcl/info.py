"""Facts about a scene or a groom, for people."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from furcl.curves import Curves
from furcl.groom_io import load_curves
from furcl.scene_io import load_scene


def describe(path: str | Path, overrides: Iterable[str] = ()) -> dict[str, str]:
    """Names and values of what a scene (.toml) or a groom file holds.

    Raises
    ------
    SceneError, GroomError      if the file cannot be used
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        return {"groom": str(path), **_describe_curves(load_curves(path))}
    scene = load_scene(path, overrides=overrides)
    film, render = scene.film, scene.render
    return {
        "scene": scene.name,
        "film": f"{film.width} x {film.height}, {film.filter} filter",
        "fibre": str(scene.build_fibre()),
        "environment": str(scene.environment),
        "render": f"{render.spp} spp, {render.sampling}, at most {render.max_depth} bounces",
        **_describe_curves(scene.build_curves()),
    }


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
