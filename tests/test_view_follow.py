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
    ["environment.radiance=0.5"],
    ["render.max_depth=20"],
]
# A scene with lamps and a body, where something is learned.
LIT = with_overrides(
    decode_scene(
        {
            **SCENE,
            "environment": {"kind": "sky", "sun_radius_deg": 5.0},
            "body": {"radii": [0.9, 0.9, 0.9]},
            "lamp": {
                "key": {
                    "kind": "sphere",
                    "position": [3.0, 0.0, 3.0],
                    "radius": 0.5,
                    "colour": [1.0, 1.0, 1.0],
                    "radiance": 20.0,
                }
            },
        }
    ),
    ["render.roulette=adjoint"],
)
OTHER_LIGHTS = [
    ["environment.sun_elevation_deg=20", "environment.scale=0.2"],
    ["lamp.key.colour=[0.1, 0.2, 1.0]"],
    ["lamp.key.position=[0.0, 3.0, 1.0]", "lamp.key.radius=1.0", "fibre.beta_m=0.5"],
    ["body.albedo=0.9"],
    ["body.radii=[1.1, 0.8, 0.8]"],
    ["render.max_depth=1"],
    ["render.roulette_threshold=0.9", "render.shadow_threshold=0.1"],
]
MADE_ANEW = [
    ["render.max_depth=3"],  # roulette never begins
    ["film.width=64"],
    ["curves.n_strands=100"],
    ["film.filter=box"],
    ["render.sampling=uniform-h"],
]
TREE_STAYS = ("film", "render")


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


@pytest.mark.parametrize("changes", OTHER_LIGHTS, ids=lambda changes: changes[0])
def test_the_light_changes_and_the_renderer_stays(
    follower: Follower, device: Device, changes: list[str]
) -> None:
    follower.follow(LIT)
    before, lit = follower.renderer, picture(follower)
    changed = with_overrides(LIT, changes)
    assert not follower.needs_set_up(changed)
    assert follower.follow(changed)
    assert follower.renderer is before
    new = Follower(device)
    new.follow(changed)
    found = picture(follower)
    np.testing.assert_array_equal(found, picture(new))
    assert not np.array_equal(found, lit)


def test_a_light_of_another_kind_is_set_up(follower: Follower) -> None:
    follower.follow(LIT)
    before = follower.renderer
    document = msgspec.to_builtins(LIT)
    del document["lamp"]
    assert follower.follow(decode_scene(document))
    assert follower.renderer is not before


@pytest.mark.parametrize("changes", MADE_ANEW, ids=lambda changes: changes[0])
def test_the_renderer_is_made_anew(follower: Follower, changes: list[str]) -> None:
    follower.follow(START)
    before = follower.renderer
    assert before is not None
    assert follower.needs_set_up(with_overrides(START, changes))
    tree = before.setup.geometry.tree
    assert follower.follow(with_overrides(START, changes))
    assert follower.renderer is not None
    assert follower.renderer is not before
    kept = follower.renderer.setup.geometry.tree is tree
    assert kept == changes[0].startswith(TREE_STAYS)
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
