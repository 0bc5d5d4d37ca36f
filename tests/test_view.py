"""The live view as a page meets it: its messages, who may send them, what it saves."""

from __future__ import annotations

import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from view_client import SCENE, Page
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import furcl
from furcl.device.choice import Device
from furcl.errors import GroomError
from furcl.scene.document import parse_toml
from furcl.scene.read import decode_scene
from furcl.viewer.picture import decoded
from furcl.viewer.show import View

SCENE_OF_TEST = decode_scene(SCENE)


@pytest.fixture(scope="module")
def view(device: Device) -> Iterator[View]:
    with View(SCENE_OF_TEST, device) as shown:
        yield shown


@pytest.fixture
def page(view: View) -> Iterator[Page]:
    page = Page(view.address)
    page.send("slot", slot="A")
    page.send("reset")
    page.wait("state", slot="A", changed=[], moved=False, doing="")
    # Another revision: pictures from before are told apart.
    page.send("set", key="render.seed", value=7)
    page.wait("state", changed=["render.seed"], doing="")
    page.send("reset")
    page.wait("state", changed=[], doing="")
    yield page
    page.close()


def fetch(address: str, **headers: str) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers)) as reply:
            return reply.status, reply.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_picture_is_that_of_a_render(view: View, page: Page, device: Device) -> None:
    # Its kernels compute all three channels and all lobes: other roundings, the same numbers.
    _, pixels = page.whole()
    rendered = furcl.render(SCENE_OF_TEST, device=device)
    assert np.abs(pixels.astype(np.float64) - rendered.rgb).mean() < 2e-3
    saved = view.session.picture().result()
    assert saved.stats["spp"] == 4
    np.testing.assert_array_equal(saved.rgb.astype(np.float16), pixels)


def test_small_picture_comes_first(view: View, page: Page) -> None:
    page.whole()
    heard: list[tuple[dict[str, Any], tuple[int, ...]]] = []

    def hear(kind: str, message: str | bytes) -> None:
        if isinstance(message, bytes):
            facts, pixels = decoded(message)
            heard.append((facts, pixels.shape))

    view.session.listen(hear)
    heard.clear()  # what was there
    page.send("orbit", azimuth_deg=30.0, elevation_deg=0.0)
    page.wait("state", moved=True)
    assert page.state["camera"]["azimuth_deg"] == pytest.approx(50.0)
    assert page.whole()[1].shape == (24, 32, 3)
    view.session.forget(hear)
    (first, shape), *others = heard
    assert first["coarse"]
    assert first["box"] == [0, 0, 32, 24]
    assert shape[0] < 24
    assert all(not facts["coarse"] and size == (24, 32, 3) for facts, size in others)


CHANGES: list[tuple[dict[str, Any], str]] = [
    ({"do": "orbit", "azimuth_deg": 90.0, "elevation_deg": 10.0}, "camera"),
    ({"do": "move", "right": 0.3, "up": 0.1}, "camera"),
    ({"do": "dolly", "factor": 2.0}, "camera"),
    ({"do": "set", "key": "fibre.beta_m", "value": 0.7}, "fibre.beta_m"),
    ({"do": "set", "key": "fibre.sigma_a", "value": [0.1, 2.0, 3.0]}, "fibre.sigma_a"),
    ({"do": "set", "key": "fibre.preset", "value": "black"}, "fibre.preset"),
    ({"do": "set", "key": "environment.radiance", "value": "0.25"}, "environment.radiance"),
]


@pytest.mark.parametrize(("message", "changed"), CHANGES, ids=[c[0]["do"] + c[1] for c in CHANGES])
def test_a_change_gives_another_picture(page: Page, message: dict[str, Any], changed: str) -> None:
    _, before = page.whole()
    page.send(**message)
    state, _ = page.wait("state", doing="")
    assert state["moved"] if changed == "camera" else changed in state["changed"]
    _, after = page.whole()
    assert np.abs(after.astype(np.float64) - before).mean() > 1e-4


def test_drafts_are_told(view: View, page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    page.whole()
    assert page.state["drafted"] == []
    monkeypatch.setattr(view.session._progressive._follower, "drafted", {"fibre"})
    page.send("set", key="film.exposure_stops", value=1.0)
    page.wait("state", exposure_stops=1.0, drafted=["fibre"])


def test_exposure_changes_no_sample(page: Page) -> None:
    found, _ = page.whole()
    page.send("set", key="film.exposure_stops", value=2.0)
    state, _ = page.wait("state", exposure_stops=2.0)
    assert state["revision"] == found["revision"]


def test_window(page: Page) -> None:
    _, whole = page.whole()
    page.send("crop", box=[8, 4, 24, 20])
    page.wait("state", crop=[8, 4, 24, 20])
    found, pixels = page.whole(box=[8, 4, 24, 20])
    assert found["full"] == [32, 24]
    # A pixel has the same samples in every window.
    np.testing.assert_array_equal(pixels, whole[4:20, 8:24])


def test_two_settings(page: Page) -> None:
    page.whole()
    page.send("copy")
    page.send("slot", slot="B")
    page.send("set", key="fibre.sigma_a", value=[5.0, 5.0, 5.0])
    page.wait("state", slot="B", same=False)
    _, b = page.whole()
    page.send("slot", slot="A")
    state, _ = page.wait("state", slot="A", doing="")
    assert state["changed"] == []
    # The samples of A are still there.
    page.send("set", key="render.spp", value=8)
    page.wait("state", spp=8)
    _, a = page.whole(spp=8)
    assert np.abs(a.astype(np.float64) - b).mean() > 1e-2


def test_saved_scene_and_pictures(view: View, page: Page, tmp_path: Path) -> None:
    page.send("orbit", azimuth_deg=15.0, elevation_deg=5.0)
    page.send("set", key="fibre.eta", value=1.4)
    page.wait("state", changed=["fibre.eta"], moved=True)
    page.whole()
    status, text = fetch(view.address + "scene.toml")
    assert status == 200
    scene = decode_scene(parse_toml(text.decode()))
    assert scene.build_fibre().eta == 1.4
    assert scene.camera.origin is not None
    assert scene == view.session._settings.seen()
    for name in ("picture.exr", "picture.png"):
        status, content = fetch(view.address + name)
        (tmp_path / name).write_bytes(content)
        assert status == 200
    loaded = furcl.Image.load(tmp_path / "picture.exr")
    assert loaded.rgb.shape == (24, 32, 3)
    assert loaded.stats["spp"] >= 1


WRONG = [
    "no JSON",
    '{"do": "dance"}',
    '{"do": "orbit", "azimuth_deg": "far", "elevation_deg": 0}',
    '{"do": "orbit", "azimuth_deg": 1e9, "elevation_deg": 0}',
    '{"do": "set", "key": "fibre.eta", "value": 99}',
    '{"do": "set", "key": "fibre.eta", "value": {"a": 1}}',
    '{"do": "set", "key": "no.such", "value": 1}',
    '{"do": "set", "key": "film.width", "value": 20000}',
    '{"do": "reset", "key": "no.such"}',
    '{"do": "crop", "box": [9, 9, 5, 5]}',
    '{"do": "slot", "slot": "C"}',
    '{"do": "set", "key": "film.height", "value": -5}',
    "[" * 5000,
]


@pytest.mark.parametrize("message", WRONG, ids=range(len(WRONG)))
def test_wrong_messages_are_answered(page: Page, message: str) -> None:
    page.whole()
    page.socket.send(message)
    found, _ = page.wait("error")
    assert found["text"]
    assert not found["fatal"]
    page.send("orbit", azimuth_deg=1.0, elevation_deg=0.0)
    page.wait("state", moved=True)
    page.whole()


def test_who_may_ask(view: View) -> None:
    parts = urlsplit(view.address)
    root = f"http://{parts.netloc}/"
    assert fetch(view.address)[0] == 200
    assert fetch(view.address + "main.js")[0] == 200
    assert fetch(root)[0] == 404
    assert fetch(root + "wrong/")[0] == 404
    assert fetch(root + "wrong/scene.toml")[0] == 404
    assert fetch(view.address + "../server.py")[0] == 404
    assert fetch(view.address + "nothing.js")[0] == 404
    assert fetch(view.address, Host="evil.example")[0] == 403
    assert fetch(view.address, Host=f"evil.example:{parts.port}")[0] == 403
    assert fetch(view.address, Origin="http://evil.example")[0] == 403
    for path, origin in [
        (parts.path, "http://evil.example"),
        (parts.path, None),
        ("/wrong/", root.rstrip("/")),
    ]:
        with pytest.raises(InvalidStatus):
            connect(f"ws://{parts.netloc}{path}socket", origin=origin)  # pyright: ignore


def test_it_listens_on_this_machine_alone(view: View) -> None:
    assert view._server._server is not None
    names = {socket.getsockname()[0] for socket in view._server._server.sockets}
    assert names == {"127.0.0.1"}


def test_one_page_closes_and_the_other_goes_on(view: View, page: Page) -> None:
    other = Page(view.address)
    other.wait("state")
    other.socket.socket.close()  # without a word
    page.send("orbit", azimuth_deg=10.0, elevation_deg=0.0)
    page.wait("state", moved=True)
    page.whole()


def test_changes_leave_nothing_behind(view: View, page: Page) -> None:
    def change(i: int) -> None:
        page.send("orbit", azimuth_deg=7.0, elevation_deg=0.0)
        page.send("set", key="fibre.beta_m", value=0.2 + 0.001 * (i % 500))
        page.wait("picture")

    page.whole()
    for i in range(3):
        change(i)
    renderer = view.session._progressive._renderer
    before = renderer.memory.total_bytes, threading.active_count()
    for i in range(30):
        change(i)
    page.whole()
    assert view.session._progressive._renderer is renderer
    assert (renderer.memory.total_bytes, threading.active_count()) == before


def test_closing_ends_all(device: Device) -> None:
    before = threading.active_count()
    shown = View(SCENE_OF_TEST, device)
    page = Page(shown.address)
    page.wait("picture")
    shown.close()
    with pytest.raises(ConnectionClosed):
        page.wait("nothing")
    assert threading.active_count() <= before + 1  # that of the client


def test_a_scene_that_cannot_be_rendered_ends_it(device: Device, tmp_path: Path) -> None:
    groom = tmp_path / "wrong.hair"
    groom.write_bytes(b"no groom")
    scene = decode_scene({**SCENE, "curves": {"generator": "file", "file": str(groom)}})
    with View(scene, device) as shown:
        assert shown.session.ended.wait(300.0)
        assert isinstance(shown.session.failure, GroomError)
