"""Pictures that look between strands are told apart from those that a segment crosses."""

from __future__ import annotations

import numpy as np
import pytest
from scene_documents import minimal

from furcl.cli.warnings import of_scene
from furcl.groom.curves import Curves
from furcl.scene.read import decode_scene

WORDS = "looks between them"
FEW = "meet a fibre"  # how much of the picture strands take, not whether they are in it


ORTHOGRAPHIC = {"projection": "orthographic", "height": 0.1}


def scene_of(**camera):
    given = {"origin": [0.0, -10.0, 0.0], "target": [0.0, 0.0, 0.0]}
    document = minimal(camera={**given, **(camera or {"vfov_deg": 0.5})})
    return decode_scene({**document, "film": {"width": 12, "height": 8}}, "scene")


def segments(ends, radius=1e-4):
    points = np.asarray(ends, np.float32).reshape(-1, 3)
    return Curves.from_arrays(points, radius, np.arange(0, len(points) + 1, 2))


def is_seen(scene, curves, n=4000):
    """Whether a point of a segment is in the picture, of n on each."""
    camera = scene.resolved_camera(curves)
    a, b = curves.points[::2, None].astype(np.float64), curves.points[1::2, None]
    on = (a + np.linspace(0.0, 1.0, n)[:, None] * (b - a)).reshape(-1, 3)
    x, y, depth = camera.on_film(on, scene.film.aspect)
    return bool(((np.abs(x) < 1.0) & (np.abs(y) < 1.0) & (depth > 0.0)).any())


def warned(scene, curves):
    return any(WORDS in line for line in of_scene(scene, curves))


def test_a_segment_across_the_picture_is_seen():
    across = segments([[-3.0, 0.0, 0.0], [3.0, 0.0, 0.01]])
    beside = segments([[-3.0, 0.0, 0.5], [3.0, 0.0, 0.5], [-3.0, 0.0, -0.5], [3.0, 0.0, -0.5]])
    assert not warned(scene_of(), across)
    assert warned(scene_of(), beside)
    assert not warned(scene_of(), segments([[-3.0, 0.0, 0.5], [3.0, 0.0, 0.5]], radius=0.48))


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_what_is_seen_is_never_warned_of(projection, rng):
    """And what is not, nearly always: rounding and radii are given room."""
    scene = scene_of(**ORTHOGRAPHIC if projection == "orthographic" else {})
    found = []
    for _ in range(300):
        curves = segments(rng.normal(0.0, 0.3, (3, 2, 3)))
        lines = [line for line in of_scene(scene, curves) if FEW not in line]
        found.append((is_seen(scene, curves), lines))
    seen = np.array([s for s, _ in found])
    said = np.array([bool(lines) for _, lines in found])
    assert 0.05 < seen.mean() < 0.95
    assert not (seen & said).any()
    assert (~seen & ~said).mean() < 0.02
