"""Lamps in scene files: what is refused and how, units, places, and many of them."""

from __future__ import annotations

import math

import lamp_kernels
import numpy as np
import pytest
from scene_documents import minimal

from furcl.errors import LightError, SceneError
from furcl.light.lamps.lamps import MOST_WIDE, Lamps
from furcl.light.lamps.record import records
from furcl.light.lights import Lights
from furcl.scene import lamps as tables
from furcl.scene.lamps import DiskLamp, DistantLamp, QuadLamp, SphereLamp
from furcl.scene.read import decode_scene, load_scene
from furcl.scene.transform import Transform

QUAD = {"kind": "quad", "radiance": 2.0}
NAN, INF = float("nan"), float("inf")

BAD = [
    ({}, "lamp.key.kind is missing"),
    ({"kind": "quod"}, "lamp.key.kind = 'quod': allowed are quad, disk"),
    ({"kind": "quad"}, "neither is given of radiance or power"),
    ({**QUAD, "power": 1.0}, "both are given of radiance or power"),
    ({**QUAD, "intensity": 1.0}, "kind = 'point' or 'spot' has it"),
    ({**QUAD, "radiance": NAN}, "lamp.key.radiance"),
    ({**QUAD, "radiance": INF}, "lamp.key.radiance"),
    ({**QUAD, "radiance": -1.0}, "lamp.key.radiance"),
    ({**QUAD, "size": [0.0, 1.0]}, "lamp.key.size[0]"),
    ({**QUAD, "size": [NAN, 1.0]}, "lamp.key.size[0]"),
    ({**QUAD, "colour": [1.0, NAN, 1.0]}, "lamp.key.colour"),
    ({**QUAD, "position": [0, 0, 1], "target": [0, 0, 1]}, "lamp.key.target = (0.0, 0.0, 1.0)"),
    ({**QUAD, "target": [0, 0, 1], "transform": {"scale": 2.0}}, "lamp.key.target = a place"),
    ({**QUAD, "transform": {"scale": 0.0}}, "lamp.key.transform.scale"),
    ({"kind": "disk", "radius": 0.0, "power": 1.0}, "lamp.key.radius"),
    ({"kind": "spot", "power": 1.0, "cone_deg": 3.0}, "lamp.key.edge_deg = 5: allowed is 0 to"),
    ({"kind": "distant", "angle_deg": 0.0, "radiance": 1.0}, "a single direction has no radiance"),
]


@pytest.mark.parametrize(("lamp", "message"), BAD, ids=[message for _, message in BAD])
def test_bad_lamps_are_refused_by_name(lamp, message):
    with pytest.raises(SceneError) as caught:
        decode_scene(minimal(lamp={"key": lamp}), "a.toml")
    assert str(caught.value).startswith("a.toml: ")
    assert "lamp.key" in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("lamp", "message"),
    [
        (SphereLamp(radiance=1.0, transform=Transform(scale=(1, 2, 1))), "need one scale"),
        (SphereLamp(radius=1e-9, power=1.0), "at most 1e+15"),
        (QuadLamp(size=(1e-200, 1e-200), radiance=1.0), "no area"),
    ],
)
def test_lamps_that_cannot_be_built_say_which(lamp, message):
    with pytest.raises(LightError) as caught:
        tables.build({"key": lamp})
    assert str(caught.value).startswith("lamp.key")
    assert message in str(caught.value)


def test_a_scene_needs_some_light(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text('[fibre]\npreset = "human-black"\n[curves]\ngenerator = "fibre"\n')
    with pytest.raises(SceneError, match="environment is missing; add it, a lamp or"):
        load_scene(path)
    path.write_text(path.read_text() + '[[lamp]]\nkind = "point"\nintensity = 1.0\n')
    scene = load_scene(path, overrides=["lamp.lamp1.intensity=3.0"])
    lights = scene.build_lights()
    assert lights.environment is None
    assert lights.lamps is not None
    assert lights.lamps.records["radiance"].tolist() == [[3.0, 3.0, 3.0]]
    with pytest.raises(SceneError, match=r"has no \[environment\]"):
        scene.build_light()


def test_a_target_is_what_it_shines_at():
    for target in ((1.0, 2.0, 3.0), (0.0, 0.0, 5.0), (0.0, 0.0, -5.0)):
        lamp = QuadLamp(position=(1.0, 0.0, 0.5), target=target, radiance=1.0)
        way = np.subtract(target, (1.0, 0.0, 0.5))
        np.testing.assert_allclose(lamp.records()["axis"][0], way / np.linalg.norm(way), atol=1e-12)
        matrix = lamp.matrix()[:3, :3]
        np.testing.assert_allclose(matrix.T @ matrix, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix) == pytest.approx(1.0)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (-2.0, 1.0, 1.0), (1.0, 3.0, -1.0)])
def test_a_mirror_turns_the_side_that_shines(scale):
    lamp = DiskLamp(transform=Transform(scale=scale, rotate_deg=(40.0, 0.0, 10.0)), radiance=1.0)
    expected = lamp.transform.normals([0.0, 0.0, -1.0])
    np.testing.assert_allclose(lamp.records()["axis"][0], expected, atol=1e-12)


def test_power_is_that_of_the_placed_lamp():
    """A quad of 2 x 3 scaled by 2 has an area of 24; both sides, twice that; spheres pi L S."""
    scale = Transform(scale=2.0)
    quad = QuadLamp(size=(2.0, 3.0), power=5.0, transform=scale, two_sided=True).records()
    assert quad["extent"][0] == pytest.approx(24.0)
    assert quad["radiance"][0, 0] == pytest.approx(5.0 / (48.0 * math.pi))
    ball = SphereLamp(radius=0.5, power=5.0, transform=scale).records()
    assert ball["radiance"][0, 0] == pytest.approx(5.0 / (4.0 * math.pi**2))
    sun = DistantLamp(irradiance=2.0, angle_deg=60.0).records()
    assert sun["radiance"][0, 0] == pytest.approx(2.0 / (math.pi * 0.25))


def test_too_many_wide_distant_lamps_are_refused():
    many = records("distant", MOST_WIDE + 1, axis=(0, 0, -1), extent=0.01, radiance=1.0)
    with pytest.raises(LightError, match="1025 distant lamps with an angle: at most 1024"):
        Lamps.make([many])


def test_dark_lamps_are_never_taken_and_stop_rays(device, rng):
    """And a scene whose lamps are all dark has no light samples."""
    lights = lamp_kernels.build({"dark": QuadLamp(position=(0, 0, 2), size=(9, 9), radiance=0.0)})
    points = rng.normal(0.0, 0.1, (1000, 3))
    found = lamp_kernels.choose(
        device, lights, points, rng.random((1000, 2)), rng.random((1000, 4))
    )
    assert not found.pdf.any()
    t, lamp = lamp_kernels.trace(device, lights, points, np.tile([0.0, 0.0, 1.0], (1000, 1)))
    assert (lamp == 0).all()
    assert np.isfinite(t).all()


@pytest.mark.parametrize("n_lamps", [50_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_many_lamps_are_all_of_their_light(device, rng, n_lamps):
    """The mean over light samples is the sum over all lamps, without a shadow."""
    lights = Lights(None, lamp_kernels.triangles(n_lamps))
    point, n = np.zeros(3), 100_000
    points = np.broadcast_to(point, (n, 3))
    found = lamp_kernels.choose(device, lights, points, rng.random((n, 2)), rng.random((n, 4)))
    values = np.divide(
        found.radiance[:, 1], found.pdf, out=np.zeros(n, np.float32), where=found.pdf > 0.0
    ).astype(np.float64)
    assert lights.lamps is not None
    lamps = lights.lamps.records
    way = lamps["centre"] + (lamps["a"] + lamps["b"]) / 3.0
    distance = np.linalg.norm(way, axis=1)
    cosine = -np.einsum("ni,ni->n", way, lamps["axis"]) / distance
    solid_angle = lamps["extent"] * np.maximum(cosine, 0.0) / distance**2
    expected = float((lamps["radiance"][:, 1] * solid_angle).sum())
    error = values.std() / math.sqrt(n)
    assert error < 0.01 * expected
    # Solid angles of small triangles by their middles: a few thousandths.
    assert abs(values.mean() - expected) < 4.0 * error + 0.005 * expected
    assert abs(values.mean() - 1.1 * expected) > 4.0 * error + 0.005 * expected
