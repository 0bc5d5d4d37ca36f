"""Grooms, transforms and cameras that change with time: files, keys, shutters; what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from groom_files import THICKNESS, npz_bytes
from scene_documents import MINIMAL, minimal

from furcl.cli.facts import of_scene
from furcl.errors import GroomError, SceneError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves
from furcl.groom.joined import Groom, Grooms
from furcl.groom.motion import MOST_STEPS, points_at
from furcl.groom.orient import scaled, z_up
from furcl.rendering.shutter import shutter_words
from furcl.scene.digest import scene_digest
from furcl.scene.motion import LARGEST_TURN_DEG, TransformKey, key_times, matrix_at
from furcl.scene.orbit import orbit
from furcl.scene.read import decode_scene, with_overrides

# Three strands of three points at three times.
STEPS = np.arange(27, dtype=np.float32).reshape(9, 3) ** 1.5 + np.array(
    [0.0, 10.0, -5.0], np.float32
).reshape(3, 1, 1)
OFFSETS = np.array([0, 3, 6, 9])
TIMES = [0.0, 0.25, 1.0]


def groom(**changes):
    given = {"points": STEPS, "radii": THICKNESS, "offsets": OFFSETS, "times": TIMES}
    return Curves.from_arrays(**{**given, **changes})


def steps_of(curves):
    """The time steps of a groom that moves."""
    assert curves.steps is not None
    return curves.steps


def moving_document(tmp_path, **tables):
    """A scene whose groom is a file with time steps."""
    save_curves(groom(), tmp_path / "moving.npz")
    file = {"generator": "file", "file": str(tmp_path / "moving.npz")}
    return minimal(curves=file, **tables)


def keyed(*keys, shutter=(0.0, 1.0), **table):
    """A scene with a groom that keys move."""
    document = {name: table for name, table in MINIMAL.items() if name != "curves"}
    fibre = {"curves": MINIMAL["curves"], "keys": list(keys), **table}
    return {**document, "groom": {"one": fibre}, "camera": {"shutter": list(shutter)}}


def test_times_that_begin_later_are_seen_from_their_first_on():
    """Where nothing is said of the shutter; any other time beyond them is refused."""
    frames = Grooms.of(groom(times=[1001, 1002, 1005]))
    still = frames.during((0.0, 0.0)).curves
    assert still.steps is None
    np.testing.assert_array_equal(still.points, STEPS[0])
    for span in ((0.0, 1.0), (1.0, 1.0), (0.0, 1002.0)):
        with pytest.raises(GroomError, match=r"1001 to 1005.*camera\.shutter"):
            frames.during(span)


@pytest.mark.parametrize("suffix", ["flat", "grid"])
def test_time_steps_survive_files(tmp_path, suffix):
    curves = groom() if suffix == "flat" else groom(
        points=STEPS.reshape(3, 3, 3, 3), offsets=None, radii=THICKNESS.reshape(3, 3)
    )  # fmt: skip
    save_curves(curves, tmp_path / "moving.npz")
    read = load_curves(tmp_path / "moving.npz", radius_scale=2.0)
    assert read.times == tuple(TIMES)
    assert np.array_equal(steps_of(read), STEPS)
    assert np.array_equal(read.points, STEPS[0])
    assert np.array_equal(read.radii, 2 * THICKNESS)
    copy = pickle.loads(pickle.dumps(read))
    assert np.array_equal(steps_of(copy), steps_of(read))
    assert not copy.points.flags.writeable


def test_times_are_even_where_none_are_given(tmp_path):
    counts = np.array([3, 3, 3])
    (tmp_path / "m.npz").write_bytes(npz_bytes(points=STEPS, radii=THICKNESS, counts=counts))
    assert load_curves(tmp_path / "m.npz").times == (0.0, 0.5, 1.0)


def test_control_points_that_move_are_refused(tmp_path):
    save_curves(groom(), tmp_path / "moving.npz")
    with pytest.raises(GroomError, match=r"points of shape \(3, 9, 3\) move"):
        load_curves(tmp_path / "moving.npz", basis="bspline")


@pytest.mark.parametrize(("up_axis", "column"), [("x", 0), ("y", 1), ("z", 2)])
def test_all_steps_are_turned_and_scaled(up_axis, column):
    turned = scaled(z_up(groom(), up_axis), 2.0)
    assert np.array_equal(steps_of(turned)[..., 2], 2 * STEPS[..., column])
    assert np.array_equal(turned.points, steps_of(turned)[0])
    assert turned.times == tuple(TIMES)


BAD = {
    "times of none": ({"points": STEPS[0]}, r"times are given, and points of shape \(9, 3\)"),
    "one step": ({"points": STEPS[:1], "times": [0.0]}, "axis of time with 1 step;.*two or more"),
    "too few times": ({"times": [0.0, 1.0]}, r"times has shape \(2,\).*expected 3 numbers"),
    "out of order": ({"times": [0.0, 2.0, 1.0]}, "times = 0, 2, 1; .*in order"),
    "twice": ({"times": [0.0, 0.0, 1.0]}, "larger than the one before"),
    "nan": ({"times": [0.0, np.nan, 1.0]}, "must be finite"),
    "words": ({"times": ["a", "b", "c"]}, "times has .*expected 3 numbers"),
    "another number of points": ({"points": STEPS[:, :8]}, "radii has shape .9,.; expected .8,"),
    "nan in a later step": ({"points": STEPS * [[[1]], [[1]], [[np.nan]]]}, "strand 0, point 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_time_steps_that_make_no_sense_are_refused(name):
    changes, words = BAD[name]
    with pytest.raises(GroomError, match=words):
        groom(**changes)


def test_what_is_short_or_a_copy_goes_only_if_it_always_is():
    still = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32)
    strands = np.concatenate([still, still, still])
    later = strands.copy()
    later[1] = [0.5, 0, 0]  # of the first strand the point that repeats goes on later
    offsets = [0, 4, 8, 12]
    curves = Curves.from_arrays(np.stack([strands, later]), 0.01, offsets)
    assert np.array_equal(curves.offsets, [0, 4, 7, 10])
    assert np.array_equal(steps_of(curves)[1][:4], later[:4])
    traced = curves.traced()
    assert np.array_equal(traced.offsets, [0, 4, 7])  # the third strand is the second one
    assert traced.dropped == {"zero_length_segments": 2, "copied_strands": 1}
    near = still + np.array([[0, 0, 0], [1e-4, 0, 0], [0, 0, 0], [0, 0, 0]], np.float32)
    for second, n_points, dropped in ((later[:4], 4, {}), (near, 3, {"short_segments": 1})):
        found = Curves.from_arrays(np.stack([near, second]), 0.01, [0, 4]).traced()
        assert (found.n_points, found.dropped) == (n_points, dropped)


def test_points_go_straight_between_times():
    curves = groom()
    for time, expected in ((0.0, 0.0), (0.125, 5.0), (0.25, 10.0), (0.5, 5.0), (1.0, -5.0)):
        assert points_at(curves, time) == pytest.approx(STEPS[0] + expected, abs=1e-5)


def test_a_shutter_cuts_the_time_of_a_file(tmp_path):
    scene = decode_scene(moving_document(tmp_path, camera={"shutter": [0.125, 0.5]}))
    curves = scene.build_curves()
    assert curves.times == (0.125, 0.25, 0.5)
    assert steps_of(curves)[:, 0, 0] == pytest.approx([5.0, 10.0, 5.0])
    still = with_overrides(scene, ["camera.shutter=[0.125,0.125]"]).build_curves()
    assert still.steps is None
    assert still.times == ()
    assert np.array_equal(still.points, curves.points)
    assert len({scene_digest(scene), scene_digest(scene, still)}) == 2
    assert of_scene(scene)["time steps"] == "3, 0.125 to 0.5"
    assert "time steps" not in of_scene(with_overrides(scene, ["camera.shutter=[0,0]"]))


def test_steps_of_all_grooms_are_joined():
    """Steps at 0, 0.25, 1 and at 0, 0.5, 1; a groom without any keeps still."""
    other = groom(times=[0.0, 0.5, 1.0])
    still = Curves.from_arrays(STEPS[0], THICKNESS, OFFSETS)
    joined = Grooms([Groom("a", groom()), Groom("b", other), Groom("c", still)]).curves
    assert joined.times == (0.0, 0.25, 0.5, 1.0)
    assert steps_of(joined)[:, 0, 0] == pytest.approx([0.0, 10.0, 5.0, -5.0])
    assert steps_of(joined)[:, 9, 0] == pytest.approx([0.0, 5.0, 10.0, -5.0])
    assert steps_of(joined)[:, 18, 0] == pytest.approx([0.0] * 4)


def test_too_many_steps_are_refused():
    points = np.zeros((MOST_STEPS + 1, 2, 3))
    points[:, 1] = 1.0
    many = Grooms([Groom("a", Curves.from_arrays(points, 0.1, [0, 2]))])
    with pytest.raises(GroomError, match=f"{MOST_STEPS + 1} time steps.*at most {MOST_STEPS}"):
        many.during((0.0, 1.0))
    assert len(many.during((0.0, 0.5)).times) == 34


def test_keys_move_a_groom_after_its_transform():
    """A quarter turn about z takes the translate of the transform round; by hand."""
    document = keyed(
        {"time": 0.0}, {"time": 1.0, "rotate_deg": [0, 0, 90], "translate": [0, 0, 1]},
        transform={"translate": [2.0, 0, 0], "scale": 0.5},
    )  # fmt: skip
    curves = decode_scene(document).build_curves()
    own = decode_scene(minimal()).build_curves()
    assert len(curves.times) == 1 + np.ceil(90 / LARGEST_TURN_DEG)
    assert curves.radii == pytest.approx(0.5 * own.radii)
    start = 0.5 * own.points + [2.0, 0, 0]
    assert steps_of(curves)[0] == pytest.approx(start, abs=1e-6)
    end = np.stack([-start[:, 1], start[:, 0], start[:, 2] + 1.0], axis=1)
    assert steps_of(curves)[-1] == pytest.approx(end, abs=1e-6)
    # Half way between two steps the way is inside the arc, by the part that the constant says.
    middle = 0.5 * (steps_of(curves)[3] + steps_of(curves)[4])
    half = np.radians(90 / (len(curves.times) - 1) / 2)
    found = np.linalg.norm(middle[:, :2], axis=1) / np.linalg.norm(start[:, :2], axis=1)
    assert found == pytest.approx(np.cos(half), rel=1e-5)


def test_between_keys_angles_change_evenly_and_matrices_straight():
    turn = [TransformKey(time=0.0), TransformKey(time=2.0, rotate_deg=(0.0, 0.0, 120.0))]
    x, y = matrix_at(turn, 0.5)[:2, 0]
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(30.0)
    back = ((-1.0, 0.0, 0.0, 4.0), (0.0, -1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0, 0, 1.0))
    keys = [TransformKey(time=0.0), TransformKey(time=2.0, matrix=back)]
    assert matrix_at(keys, 0.5)[0] == pytest.approx([0.5, 0.0, 0.0, 1.0])
    assert key_times(keys) == [0.0, 2.0]


A, B = {"time": 0.0}, {"time": 1.0, "translate": [1.0, 0.0, 0.0]}
REFUSED = {
    "one key": (keyed(A), r"groom\.one\.keys: there is one, at time 0; give two or more"),
    "out of order": (keyed(B, A), r"groom\.one\.keys\[1\]\.time = 0: expected more than 1"),
    "no time": (keyed(A, {"translate": [1, 0, 0]}), r"keys\[1\]\.time is missing"),
    "other scales": (keyed(A, {**B, "scale": 2.0}), r"keys: their scales are 1 to 2;"),
    "uneven scale": (keyed(A, {**B, "scale": [1, 1, 2]}), "keys: one scales by 1, 1, 2"),
    "unknown": (keyed(A, {**B, "shift": 1}), r"groom\.one\.keys\[1\].*shift"),
    "no list": ({**keyed(), "groom": {"one": {"curves": MINIMAL["curves"], "keys": A}}},
                r"groom\.one\.keys.*array"),
    "backwards": (minimal(camera={"shutter": [1.0, 0.0]}), "camera.shutter = .*closes before"),
    "camera beyond": (
        minimal(camera={"origin": [1, 0, 0], "target": [0, 0, 0], "shutter": [0, 2],
                        "keys": [{"time": 0}, {"time": 1, "origin": [2, 0, 0]}]}),
        r"camera.shutter = \[0.0, 2.0\]: keys say where the camera is from 0 to 1"),
    "camera nowhere": (
        minimal(camera={"keys": [{"time": 0, "origin": [1, 0, 0]}, {"time": 1}]}),
        r"camera: keys\[0\].target is missing, and the camera has none"),
    "camera in its target": (
        minimal(camera={"origin": [1, 0, 0], "target": [0, 0, 0],
                        "keys": [{"time": 0}, {"time": 1, "origin": [0, 0, 0]}]}),
        r"camera: keys\[1\]: origin and target are the same"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_keys_that_make_no_sense_are_refused(name):
    document, words = REFUSED[name]
    with pytest.raises(SceneError, match=words):
        decode_scene(document)


@pytest.mark.parametrize(
    ("source", "words"),
    [("keys", "keys of groom one: its times are 0 to 1, and the camera's shutter is open from 0.5"),
     ("file", "groom groom: its times are 0 to 1, and .* open from 0.5 to 1.5; set camera.shut")],
)  # fmt: skip
def test_a_shutter_beyond_keys_is_refused(tmp_path, source, words):
    document = keyed(A, B) if source == "keys" else moving_document(tmp_path)
    scene = with_overrides(decode_scene(document), ["camera.shutter=[0.5,1.5]"])
    with pytest.raises(GroomError, match=words):
        scene.build_curves()


CAMERA = {
    "origin": [4.0, 0, 0], "target": [0, 0, 0], "shutter": [0.0, 1.0],
    "keys": [{"time": 0.0}, {"time": 0.5, "origin": [4.0, 2.0, 0]}, {"time": 2.0, "up": [0, 1, 1]}],
}  # fmt: skip


def test_a_camera_goes_straight_between_its_keys():
    scene = decode_scene(minimal(camera=CAMERA))
    camera = scene.resolved_camera(scene.build_curves())
    assert camera.at(0.25).origin == (4.0, 1.0, 0.0)
    assert camera.at(1.25).up == pytest.approx((0.0, 0.5, 1.0))
    words = shutter_words(camera, [])
    assert words[:3].tolist() == [0.0, 0.5, 1.0]
    places = words[3:].reshape(3, 3, 3)
    assert places[:, 0].tolist() == [[4, 0, 0], [4, 2, 0], pytest.approx([4, 4 / 3, 0])]
    assert places[:, 2].tolist()[:2] == [[0, 0, 1], [0, 0, 1]]
    assert camera.focus_distance is None
    assert len(camera.at(0.0).places) == 1


def test_a_turntable_turns_the_keys_of_its_camera():
    scene = decode_scene(minimal(camera=CAMERA))
    turned = orbit(scene, scene.build_curves(), [90.0])[0]
    assert turned.at(0.5).origin == pytest.approx((-2.0, 4.0, 0.0))
    assert turned.keys[2].up == pytest.approx((-1.0, 0.0, 1.0))
