"""Renders that are stopped and go on: the same bits as those that never stopped."""

import errno
from typing import Any

import pytest
from scene_documents import fur_patch

import furcl
from furcl.errors import CheckpointError
from furcl.rendering import checkpoint
from furcl.rendering.learning import Learning
from furcl.rendering.plan import SamplePlan
from furcl.rendering.state import read_header
from furcl.scene.read import with_overrides

# What a render can have to remember: nothing but the film; learned thresholds; a plan; one colour.
KINDS = {
    "even": {},
    "sobol": {"sequence": "sobol"},
    "learning": {"roulette": "adjoint", "light_sampling": "mis"},
    "adaptive": {"allocation": "adaptive", "light_sampling": "mis"},
    "no variance": {"variance": False, "statistics": False},
}


def _scene(**render):
    return with_overrides(fur_patch({"preset": "human-black"}, spp=20, **render), size=(24, 16))


def _render(*arguments: Any, **keywords: Any) -> Any:
    return furcl.render(*arguments, **keywords)


class _StopAt:
    """A progress that stops a render after some calls."""

    def __init__(self, calls):
        self.calls = calls

    def __call__(self, done, total):
        self.calls -= 1
        return self.calls <= 0


def _bits(image):
    variance = b"" if image.variance is None else image.variance.tobytes()
    return image.rgb.tobytes(), variance, image.samples.tobytes()


COUNTS = ("rays", "paths", "lobes", "nonfinite", "path_length", "samples", "steps", "spp")


@pytest.mark.parametrize("kind", KINDS)
def test_the_bits_are_those_of_an_unbroken_render(kind, device, tmp_path):
    """Stopped wave after wave, with waves of other sizes each time."""
    scene, path = _scene(**KINDS[kind]), tmp_path / "a.checkpoint"
    whole = _render(scene, device=device, wave_size=1000)
    image, resume, stops = whole, None, 0
    for wave_size in (1000, 777, 300, 1500, 1 << 15):
        stop = _StopAt(2)
        image = _render(
            scene, device=device, wave_size=wave_size, progress=stop if wave_size < 4000 else None,
            checkpoint=path, resume=resume,
        )  # fmt: skip
        resume, stops = path, stops + (not image.stats["complete"])
    assert stops == 4
    assert image.stats["complete"]
    assert _bits(image) == _bits(whole)
    assert {n: image.stats[n] for n in COUNTS} == {n: whole.stats[n] for n in COUNTS}


def test_a_target_is_reached_with_the_same_bits(device, tmp_path):
    scene, path = with_overrides(_scene(), spp=4000), tmp_path / "a.checkpoint"
    options = {"device": device, "target_rmse": 0.02, "spp": 4000}
    whole = _render(scene, **options)
    assert whole.stats["complete"]
    stopped = _render(scene, **options, wave_size=500, progress=_StopAt(5), checkpoint=path)
    assert stopped.stats["paths"] < whole.stats["paths"]
    assert _bits(_render(scene, **options, resume=path)) == _bits(whole)


def test_more_samples_are_added_to_a_finished_render(device, tmp_path):
    path = tmp_path / "a.checkpoint"
    _render(_scene(), device=device, spp=8, checkpoint=path, checkpoint_minutes=60)
    more = _render(_scene(), device=device, spp=20, resume=path)
    assert _bits(more) == _bits(_render(_scene(), device=device))


def test_nothing_is_kept_of_a_render_that_is_not_stopped(device, tmp_path):
    _render(_scene(), device=device, spp=1, checkpoint=tmp_path / "a", time_limit=1e-9)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("kind", "owner", "left_out", "waves"),
    [
        ("learning", Learning, "learned", 3),
        ("learning", Learning, "learning counts", 3),
        ("adaptive", SamplePlan, "pilots", 4),
        ("adaptive", SamplePlan, "counts", 4),
    ],
)
def test_bits_differ_where_a_part_is_left_out(
    kind, owner, left_out, waves, device, tmp_path, monkeypatch
):
    scene, path, parts = _scene(**KINDS[kind]), tmp_path / "a.checkpoint", owner.parts
    whole = _render(scene, device=device)
    monkeypatch.setattr(
        owner, "parts", lambda self: {n: p for n, p in parts(self).items() if n != left_out}
    )
    _render(scene, device=device, wave_size=700, progress=_StopAt(waves), checkpoint=path)
    assert _bits(_render(scene, device=device, resume=path)) != _bits(whole)


@pytest.fixture(scope="module")
def kept(device, tmp_path_factory):
    path = tmp_path_factory.mktemp("kept") / "a.checkpoint"
    _render(_scene(), device=device, wave_size=1000, progress=_StopAt(3), checkpoint=path)
    return path


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ({}, {"seed": 3}, "seed was 0, is 3"),
        ({}, {"spp": 7}, "holds 7.5 samples a pixel, 7 are asked for"),
        ({}, {"sampling": "uniform-h"}, "sampling was full-cdf, is uniform-h"),
        ({}, {"target_rmse": 0.1}, "target"),
        ({"size": (16, 24)}, {}, "another scene; size was [24, 16], is [16, 24]"),
        ({"overrides": ["camera.azimuth_deg=3"]}, {}, "another scene"),
        ({"overrides": ["curves.seed=3"]}, {}, "another scene"),
        ({"overrides": ["render.variance=false"]}, {}, "variance was True, is False"),
    ],
)  # fmt: skip
def test_another_render_is_refused(change, options, said, kept, device):
    with pytest.raises(CheckpointError) as error:
        _render(with_overrides(_scene(), **change), device=device, resume=kept, **options)
    assert said in str(error.value)
    assert str(kept) in str(error.value)


def test_another_device_is_said(kept, device, monkeypatch, caplog):
    real = checkpoint.identity

    def other(*arguments):
        return {**real(*arguments), "device": ["other", "platform", "1"]}

    monkeypatch.setattr(checkpoint, "identity", other)
    assert _render(_scene(), device=device, resume=kept).stats["complete"]
    assert "the bits are not those of one device" in caplog.text


@pytest.mark.parametrize("place", [0, 10, 25, 100, 2000, 5000, -40, -1])
def test_a_changed_byte_is_found(place, kept, tmp_path):
    data, path = bytearray(kept.read_bytes()), tmp_path / "a"
    data[place] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckpointError, match=r"damaged|does not start"):
        read_header(path)


@pytest.mark.parametrize("n_bytes", [0, 5, 19, 30, 60, 3000, -1])
def test_a_file_that_is_cut_is_found(n_bytes, kept, tmp_path):
    path = tmp_path / "a"
    path.write_bytes(kept.read_bytes()[:n_bytes])
    with pytest.raises(CheckpointError, match=r"damaged|does not start"):
        read_header(path)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"checkpoint": "{}/a", "checkpoint_minutes": -1.0}, "expected a number above 0"),
        ({"checkpoint": "{}/a", "checkpoint_minutes": float("nan")}, "expected a number above 0"),
        ({"checkpoint_minutes": 1.0}, "there is no file"),
        ({"checkpoint": "{}"}, "is a folder"),
        ({"resume": "{}/none"}, "there is no such file"),
        ({"resume": "{}"}, "there is no such file"),
    ],
)
def test_what_makes_no_sense_is_refused(options, said, device, tmp_path):
    options = {
        name: value.format(tmp_path) if isinstance(value, str) else value
        for name, value in options.items()
    }
    with pytest.raises(CheckpointError, match=said):
        _render(_scene(), device=device, **options)


def test_a_full_disk_is_said_and_the_render_goes_on(device, tmp_path, monkeypatch, caplog):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "a.checkpoint"
    path.write_bytes(b"older")
    monkeypatch.setattr(checkpoint, "write_state", full)
    image = _render(
        _scene(), device=device, spp=2, wave_size=300, checkpoint=path, checkpoint_minutes=1e-9
    )
    assert image.stats["complete"]
    assert "No space left on device" in caplog.text
    assert path.read_bytes() == b"older"
