"""What changes of a scene make anew; a renderer that followed shows what a new one does."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from view_client import SCENE

from furcl.device.choice import Device
from furcl.errors import SceneError
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.profiles import build_profiles, draft_profiles
from furcl.scene.document import parse_toml
from furcl.scene.read import decode_scene, load_scene, with_overrides
from furcl.scene.write import scene_text
from furcl.viewer import camera as cameras
from furcl.viewer.follow import Follower

START = decode_scene(SCENE)

STAYS = [
    ["fibre.beta_m=0.6"],
    ["fibre.sigma_a=[0.2, 1.0, 3.0]"],
    ["fibre.alpha_deg=0"],
    ["camera.azimuth_deg=70"],
    ["film.width=24", "film.height=12"],
    ["film.crop=[4, 4, 20, 12]"],
    ["render.seed=9"],
]
MADE_ANEW = [
    ["environment.radiance=0.5"],
    ["film.width=64"],
    ["curves.n_strands=100"],
    ["render.max_depth=3"],
    ["film.filter=box"],
]


def picture(follower: Follower) -> np.ndarray:
    renderer = follower.renderer
    assert renderer is not None
    renderer.advance()
    return renderer.film.read(renderer.memory)[0]


@pytest.fixture(scope="module")
def follower(device: Device) -> Follower:
    return Follower(device)


@pytest.mark.parametrize("changes", STAYS, ids=lambda changes: changes[0])
def test_the_renderer_stays_and_shows_what_a_new_one_does(
    follower: Follower, device: Device, changes: list[str]
) -> None:
    follower.follow(START)
    before = follower.renderer
    changed = with_overrides(START, changes)
    assert follower.follow(changed)
    assert follower.renderer is before
    new = Follower(device)
    new.follow(changed)
    np.testing.assert_array_equal(picture(follower), picture(new))


@pytest.mark.parametrize("changes", MADE_ANEW, ids=lambda changes: changes[0])
def test_the_renderer_is_made_anew(follower: Follower, changes: list[str]) -> None:
    follower.follow(START)
    before = follower.renderer
    assert follower.follow(with_overrides(START, changes))
    assert follower.renderer is not before
    assert np.isfinite(picture(follower)).all()


@pytest.mark.parametrize("change", ["film.exposure_stops=2", "render.spp=9"])
def test_samples_stay(follower: Follower, change: str) -> None:
    follower.follow(START)
    picture(follower)
    assert follower.renderer is not None
    done = follower.renderer.samples_done
    assert not follower.follow(with_overrides(START, [change]))
    assert follower.renderer.samples_done == done


def test_drafts_are_profiles_with_more_noise(device: Device) -> None:
    fibre = Fibre.preset("human-white", kappa=0.637)
    draft, noisier = draft_profiles(device, fibre)
    exact = build_profiles(device, fibre, photons=400, cache=False)
    assert draft is not None
    assert exact is not None
    assert noisier
    # Measured: 0.23 is the error of its worst bins.
    assert draft.relative_error < 0.4
    ahead = draft.azimuth.density.mean(axis=(0, 1)) - exact.azimuth.density.mean(axis=(0, 1))
    assert np.abs(ahead).max() < 0.1 * exact.azimuth.density.mean()


@pytest.mark.parametrize("name", ["portrait", "two_grooms", "lamps", "motion", "black_hair"])
def test_written_scenes_are_read_as_they_were(name: str) -> None:
    scene = load_scene(name)
    assert decode_scene(parse_toml(scene_text(scene))) == scene


def test_cameras_turn_around_their_target() -> None:
    camera = START.resolved_camera(START.build_curves())
    turned = cameras.orbited(camera, 30.0, 15.0)
    assert turned.target == camera.target
    angles, before = cameras.angles(turned), cameras.angles(camera)
    assert angles["azimuth_deg"] == pytest.approx(before["azimuth_deg"] + 30.0)
    assert angles["elevation_deg"] == pytest.approx(before["elevation_deg"] + 15.0)
    assert angles["distance"] == pytest.approx(before["distance"])
    over = cameras.orbited(camera, 0.0, 300.0)
    assert cameras.angles(over)["elevation_deg"] == pytest.approx(89.0)
    closer = cameras.dollied(turned, 0.5)
    assert cameras.angles(closer)["distance"] == pytest.approx(0.5 * angles["distance"])
    assert closer.focus_distance == pytest.approx(0.5 * angles["distance"])
    x, y, _ = camera.on_film(np.array([camera.target]))
    moved = cameras.shifted(camera, 0.25, -0.5)
    x1, y1, _ = moved.on_film(np.array([camera.target]))
    # A picture is 2 high.
    assert (x1 - x, y1 - y) == (pytest.approx(-0.5), pytest.approx(1.0))


def test_a_renderer_that_changes_has_no_layers(device: Device) -> None:
    film = msgspec.structs.replace(START.film, layers=("depth",))
    with pytest.raises(SceneError, match=r"film\.layers"):
        Follower(device).follow(msgspec.structs.replace(START, film=film))
