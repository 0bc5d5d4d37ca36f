"""Scenes whose picture is black or slow: `furcl info` says why, and nothing of good ones."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from faults.case import Case
from furcl.cli.warnings import of_scene
from furcl.groom.curves import Curves
from furcl.paths import scene_folder
from furcl.scene.read import load_scene

FUR = """
[fibre]
preset = "human-black"
[environment]
kind = "constant"
[curves]
generator = "fur"
n_strands = 200
"""
_SCENES = {
    "camera inside the body": (
        "[camera]\norigin = [0.0, 0.0, 0.0]\ntarget = [1.0, 0.0, 0.0]\n[body]\n",
        "inside the body",
    ),
    "groom inside the body": ("[body]\nradii = [50.0, 50.0, 50.0]\n", "groom is inside the body"),
    "groom behind the camera": (
        "[camera]\norigin = [9.0, 0.0, 0.0]\ntarget = [20.0, 0.0, 0.0]\n",
        "behind the camera",
    ),
    "nothing in view": (
        "[camera]\norigin = [9.0, 0.0, 0.0]\ntarget = [9.0, 9.0, 1.0]\nvfov_deg = 10.0\n",
        "outside the picture",
    ),
    "a view between strands": (
        "[camera]\norigin = [9.0, 0.0, 0.0]\ntarget = [0.0, 0.3, 0.4]\nvfov_deg = 0.1\n",
        "looks between them",
    ),
    "a groom smaller than a pixel": (
        "[camera]\norigin = [1e7, 0.0, 0.0]\ntarget = [0.0, 0.0, 0.0]\n",
        "pixels large",
    ),
    "fibres much thinner than a pixel": ("", "pixels thick"),
    "fewer samples than would meet a fibre": (
        "[film]\nwidth = 4\nheight = 4\n[render]\nspp = 1\n",
        "meet a fibre",
    ),
    "10^12 samples": ("[film]\nwidth = 1024\nheight = 1024\n[render]\nspp = 1000000\n", "hours"),
}


def _said(text: str, folder: Path, move: np.ndarray | float = 0.0, stray: float = 0.0) -> list[str]:
    path = folder / "a.toml"
    path.write_text(text + FUR.lstrip())
    scene = load_scene(path)
    curves = scene.build_curves()
    points = curves.points + np.float32(move)
    points[0] += np.float32(stray)
    radii = curves.radii * np.float32(1e-7 if "thin" in folder.name else 1.0)
    return list(of_scene(scene, Curves.from_arrays(points, radii, curves.offsets)))


def _warned(text: str, words: str, folder: Path, quick: bool) -> str:
    sub = folder / ("thin" if words == "pixels thick" else "plain")
    sub.mkdir()
    said = _said(text, sub)
    assert any(words in warning for warning in said), f"says {said}"
    return next(warning for warning in said if words in warning)


def _far(folder: Path, quick: bool) -> str:
    said = _said("", folder, move=1e6)
    assert any("away from the origin" in warning for warning in said), f"says {said}"
    return said[0]


def _stray(folder: Path, quick: bool) -> str:
    said = _said("", folder, stray=1e9)
    assert any("stray points" in warning for warning in said), f"says {said}"
    return said[0]


def _none(folder: Path, quick: bool) -> str:
    """Scenes that come with furcl."""
    names = (
        ["single_fibre", "red_fox"] if quick else [p.stem for p in scene_folder().glob("*.toml")]
    )
    for name in names:
        scene = load_scene(name) if name != "groom" else None
        said = list(of_scene(scene, scene.build_curves())) if scene else []
        assert not said, f"{name}: {said}"
    return f"nothing of {len(names)} scenes of furcl"


CASES = [
    *(Case(name, partial(_warned, *given)) for name, given in _SCENES.items()),
    Case("a groom 10^6 away from the origin", _far),
    Case("one point 10^9 away", _stray),
    Case("scenes that are fine", _none),
]
