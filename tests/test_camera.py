"""Cameras: parallel rays, windows of a picture, and going round a groom."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from kernel_mutants import substitute
from scene_documents import even_patch, fur_patch
from scipy import stats

import furcl
from furcl.errors import SceneError
from furcl.fibre.double_cylinder.reference import UNSCATTERED
from furcl.image.image import Image
from furcl.oracle.host_render import HostRenderer
from furcl.rendering.frames import frame_numbers, frame_path, render_frames
from furcl.rendering.renderer import Renderer
from furcl.scene.camera import Camera
from furcl.scene.orbit import orbit, rotation
from furcl.scene.read import decode_scene, with_overrides

ALPHA = 1e-3
ORTHOGRAPHIC = {
    "projection": "orthographic",
    "origin": [0.0, -1.0, 1.0],
    "target": [0.0, 0.0, 0.15],
    "height": 0.6,
}


def cropped(scene, box):
    return with_overrides(scene, [f"film.crop={list(box)}"])


@pytest.mark.parametrize("aspect", [0.5, 2.0])
@pytest.mark.parametrize("view", [(0.0, 0.0), (30.0, 20.0), (90.0, 89.0)])
@pytest.mark.parametrize("margin", [0.0, 0.3])
def test_an_orthographic_camera_frames(aspect, view, margin, rng):
    points = rng.normal(size=(200, 3)) * [1.0, 2.0, 4.0] + [10.0, -3.0, 7.0]
    camera = Camera(
        projection="orthographic", azimuth_deg=view[0], elevation_deg=view[1], margin=margin
    ).resolved(points, aspect)
    x, y, depth = camera.on_film(points, aspect)
    assert (depth > 0.0).all()
    sides = sorted([x.max(), -x.min(), y.max(), -y.min()])
    np.testing.assert_allclose(sides[2:], 1.0 - margin, rtol=1e-9)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_rays_meet_the_film_where_they_should(projection, rng):
    camera = Camera(projection=projection, azimuth_deg=20.0).resolved(rng.normal(size=(9, 3)), 1.5)
    places = rng.random((2, 50))
    origins, directions = camera.rays(places[0], places[1], 1.5)
    x, y, _ = camera.on_film(origins + rng.uniform(1, 9, (50, 1)) * directions, 1.5)
    np.testing.assert_allclose([0.5 + 0.5 * x, 0.5 - 0.5 * y], places, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"height": 2.0}, "height = 2.0 belongs to projection = 'orthographic'"),
        ({"projection": "orthographic", "vfov_deg": 20.0}, "vfov_deg = 20.0 belongs to"),
        (
            {"projection": "orthographic", "origin": (0, 1, 0), "target": (0, 0, 0)},
            "height is missing",
        ),
        ({"projection": "orthographic", "height": 1.0, "margin": 0.1}, "remove one"),
    ],
)
def test_values_of_the_other_projection_are_refused(values, words):
    with pytest.raises(ValueError, match=words):
        Camera(**values)


def test_an_orthographic_camera_must_be_resolved_first():
    with pytest.raises(ValueError, match=r"call resolved\(points, aspect\) first"):
        _ = Camera(projection="orthographic").half_height


def orthographic_z(device, seed, aperture=0.0):
    """z of a pixel's mean radiance, device against host, of pixels of a patch of fur."""
    scene = decode_scene(
        {
            **msgspec.to_builtins(even_patch()),
            "camera": {**ORTHOGRAPHIC, "aperture_radius": aperture},
            "film": {"width": 6, "height": 4, "filter": "box"},
            "environment": {"kind": "sky", "sun_radius_deg": 20.0},
        }
    )
    image = furcl.render(scene, spp=4096, seed=seed, device=device)
    host = HostRenderer(scene, UNSCATTERED)
    rng = np.random.default_rng(seed)
    z = []
    for x, y in ((0, 0), (5, 0), (3, 2)):
        mean, variance = host.pixel(x, y, 1000, rng)
        assert image.variance is not None
        total = variance + image.variance[y, x]
        z.append(((image.rgb[y, x] - mean) / np.sqrt(total))[0])
    return np.array(z)


@pytest.mark.statistical
def test_an_orthographic_picture_is_the_host_renderers(device, seed):
    z = orthographic_z(device, seed)
    assert np.abs(z).max() < stats.norm.isf(0.5 * ALPHA / len(z))


@pytest.mark.statistical
def test_a_picture_of_rays_that_spread_is_not(device, seed, monkeypatch):
    """A mutant of the test above."""
    spread = "through = camera->forward.xyz + beside;"
    substitute(monkeypatch, r"through = camera->forward\.xyz;", spread, "stages/generate.cl")
    z = orthographic_z(device, seed)
    assert np.abs(z).max() > 2.0 * stats.norm.isf(0.5 * ALPHA / len(z))


def test_parallel_rays_see_one_size_at_every_distance(device):
    """A fibre along the view axis' normal is as wide as its diameter over the height says."""
    scene = decode_scene(
        {
            "film": {"width": 64, "height": 64, "filter": "box"},
            "camera": {
                "projection": "orthographic", "origin": [0, -50, 0], "target": [0, 0, 0],
                "height": 8.0,
            },
            "fibre": {"preset": "human-black"},
            "environment": {"kind": "constant", "radiance": 0.0},
            "curves": {"generator": "fibre", "axis": "x", "radius": 1.0, "length": 100.0},
            "render": {"spp": 1},
        }
    )  # fmt: skip
    near = with_overrides(scene, ["camera.origin=[0, -5, 0]"])
    assert Renderer(scene, device).features.orthographic
    a, b = (Renderer(s, device) for s in (scene, near))
    for renderer in (a, b):
        renderer.advance(1)
    # Rows 24 to 39 of 64 see the fibre of diameter 2 in a height of 8.
    assert a.hits == b.hits == 16 * 64


@pytest.mark.parametrize("allocation", ["even", "adaptive"])
@pytest.mark.parametrize("box", [(5, 3, 20, 12), (0, 0, 1, 1), (23, 15, 24, 16), (0, 9, 24, 16)])
def test_a_window_has_the_bits_of_the_whole_picture(device, box, allocation):
    """With allocation by error pixels get what the others leave them; the first four samples are
    the same."""
    scene = with_overrides(fur_patch(spp=4), [f"render.allocation={allocation}"])
    whole, part = (furcl.render(s, device=device) for s in (scene, cropped(scene, box)))
    left, top, right, bottom = box
    assert np.array_equal(part.rgb, whole.rgb[top:bottom, left:right])
    assert part.variance is not None
    assert whole.variance is not None
    assert np.array_equal(part.variance, whole.variance[top:bottom, left:right])
    assert part.stats["crop"] == list(box)


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        (r"\(float\)p\.x", "(float)(p.x - wave->crop_left)"),
        (r"\(float\)picture_height\(wave\)", "(float)wave->height"),
        (r"p\.index = p\.y \* picture_width\(wave\)", "p.index = p.y * wave->width"),
    ],
)
def test_a_window_at_another_place_is_seen(device, monkeypatch, pattern, text):
    """Mutants of the test above."""
    scene, box = fur_patch(spp=4), (5, 3, 20, 12)
    whole = furcl.render(scene, device=device).cropped(*box)
    substitute(monkeypatch, pattern, text, "stages/generate.cl")
    part = furcl.render(cropped(scene, box), device=device)
    assert not np.array_equal(part.rgb, whole.rgb)


def test_a_window_is_written_as_the_data_window(device, tmp_path):
    scene, box = fur_patch(spp=2), (5, 3, 20, 12)
    image = furcl.render(cropped(scene, box), device=device)
    image.save(tmp_path / "part.exr")
    loaded = Image.load(tmp_path / "part.exr")
    assert loaded.window == image.window
    assert np.array_equal(loaded.rgb, image.rgb)
    import OpenEXR

    header = OpenEXR.File(str(tmp_path / "part.exr")).header()
    for name, corners in {
        "dataWindow": ((5, 3), (19, 11)),
        "displayWindow": ((0, 0), (23, 15)),
    }.items():
        assert np.array_equal(header[name], corners)


@pytest.mark.parametrize("box", [(0, 0, 0, 5), (3, 2, 2, 5), (0, 0, 25, 16), (0, 0, 24, 17)])
def test_a_window_without_pixels_or_outside_is_refused(box):
    with pytest.raises(SceneError, match=r"film\.crop = .* holds no pixels of a picture"):
        cropped(fur_patch(), box)


def test_turning_is_by_rodrigues():
    turn = rotation((0.0, 0.0, 2.0), math.radians(90.0))
    np.testing.assert_allclose(turn @ [1.0, 0.0, 5.0], [0.0, 1.0, 5.0], atol=1e-15)
    turn = rotation((1.0, 1.0, 1.0), math.radians(120.0))
    np.testing.assert_allclose(turn @ [1.0, 2.0, 3.0], [3.0, 1.0, 2.0], atol=1e-15)


ANGLES = [0.0, 45.0, 90.0, 200.0]


@pytest.mark.parametrize("extra", [[], ["camera.projection=orthographic"]])
def test_a_turning_camera_keeps_its_distance_and_sees_all(extra):
    scene = with_overrides(fur_patch(), ["camera.margin=0.0", *extra])
    curves = scene.build_curves()
    cameras: list[Any] = orbit(scene, curves, ANGLES)
    tightest = 0.0
    for camera, angle in zip(cameras, ANGLES, strict=True):
        x, y, depth = camera.on_film(curves.points, scene.film.aspect)
        assert (depth > 0.0).all()
        assert max(np.abs(x).max(), np.abs(y).max()) < 1.0
        tightest = max(tightest, np.abs(x).max(), np.abs(y).max())
        a, b = (np.subtract(c.origin, c.target) for c in (cameras[0], camera))
        np.testing.assert_allclose(np.linalg.norm(b), np.linalg.norm(a))
        turned = math.degrees(math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]))
        assert turned % 360.0 == pytest.approx(angle, abs=1e-9)
    assert tightest > 0.95


def test_a_camera_by_hand_turns_around_its_target():
    scene = even_patch()
    curves = scene.build_curves()
    first, half = orbit(scene, curves, [0.0, 180.0])
    assert first.origin == pytest.approx(scene.camera.origin)
    assert half.origin == pytest.approx((0.0, 0.7, 0.7))
    assert half.target == pytest.approx(scene.camera.target)


@pytest.mark.parametrize("roulette", ["depth", "adjoint"])
def test_a_frame_has_the_bits_of_a_render_of_its_own(device, roulette):
    scene = with_overrides(fur_patch(spp=8), [f"render.roulette={roulette}"])
    curves = scene.build_curves()
    frames = dict(render_frames(scene, range(3, 6), orbit_deg=300.0, device=device))
    assert list(frames) == [3, 4, 5]
    cameras = orbit(scene, curves, [0.0, 100.0, 200.0])
    for camera, image in zip(cameras, frames.values(), strict=True):
        alone = msgspec.structs.replace(scene, camera=camera)
        expected = furcl.render(alone, device=device)
        assert np.array_equal(image.rgb, expected.rgb)
        assert image.stats["rays"] == expected.stats["rays"]
    assert not np.array_equal(frames[3].rgb, frames[4].rgb)


def test_frames_share_what_stays(device, monkeypatch):
    built = []
    set_up = Renderer.__init__

    def count(self, *arguments, **keywords):
        built.append(self)
        set_up(self, *arguments, **keywords)

    monkeypatch.setattr(Renderer, "__init__", count)
    images = list(render_frames(fur_patch(spp=1), range(4), orbit_deg=90.0, device=device))
    assert (len(images), len(built)) == (4, 1)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"projection": "orthographic", "height": 1.0}, "projection"),
        ({"aperture_radius": 0.1}, "lens"),
    ],
)
def test_a_camera_of_another_kind_needs_other_kernels(device, change, what):
    renderer = Renderer(fur_patch(), device)
    camera = Camera(origin=(0, -5, 0), target=(0, 0, 0), **change)
    with pytest.raises(SceneError, match=f"another {what}"):
        renderer.look(camera)


@pytest.mark.parametrize(
    ("text", "frames"),
    [("0:24", range(24)), ("5:6", range(5, 6)), ("10:30:10", range(10, 30, 10))],
)
def test_frames_are_numbered_as_ranges(text, frames):
    assert frame_numbers(text) == frames


@pytest.mark.parametrize("text", ["", "24", "5:5", "9:3", "0:24:0", "-1:4", "a:b", "0:9999999"])
def test_other_frames_are_refused(text):
    with pytest.raises(SceneError, match=r"--frames .*expected FIRST:END"):
        frame_numbers(text)


def test_files_of_frames(tmp_path):
    assert frame_path(tmp_path / "a.####.exr", 7) == tmp_path / "a.0007.exr"
    assert frame_path(tmp_path / "a.#.exr", 12) == tmp_path / "a.12.exr"
