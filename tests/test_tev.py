"""What tev is sent while a picture renders, read byte by byte as tev reads it."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from view_client import SCENE

import furcl
from furcl.device.choice import Device
from furcl.errors import ImageError
from furcl.image.size import Window
from furcl.image.tev import Display
from furcl.scene.read import decode_scene


class Reader:
    """Values of a packet, in their order; nothing may be left."""

    def __init__(self, content: bytes) -> None:
        self.content, self.at = content, 0

    def numbers(self, form: str) -> tuple[Any, ...]:
        found = struct.unpack_from(f"<{form}", self.content, self.at)
        self.at += struct.calcsize(f"<{form}")
        return found

    def text(self) -> str:
        end = self.content.index(b"\0", self.at)
        found, self.at = self.content[self.at : end].decode(), end + 1
        return found

    def rest(self) -> bytes:
        found, self.at = self.content[self.at :], len(self.content)
        return found


class FakeTev(threading.Thread):
    """Takes one connection and draws its pictures; ends it after `most` packets."""

    def __init__(self, most: int = 1 << 30) -> None:
        super().__init__(daemon=True)
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.most, self.packets = most, 0
        self.pictures: dict[str, np.ndarray] = {}
        self.updates: list[tuple[int, int, int, int]] = []
        self.start()

    def run(self) -> None:
        connection, _ = self.socket.accept()
        with connection, connection.makefile("rb") as stream:
            while self.packets < self.most and (head := stream.read(4)):
                (size,) = struct.unpack("<I", head)
                self.take(Reader(stream.read(size - 4)))
                self.packets += 1
        self.socket.close()

    def take(self, reader: Reader) -> None:
        kind, focus = reader.numbers("bb")
        assert focus == 0
        name = reader.text()
        if kind == 4:
            width, height, n = reader.numbers("iii")
            assert [reader.text() for _ in range(n)] == ["R", "G", "B"]
            self.pictures[name] = np.full((height, width, n), np.nan, np.float32)
        else:
            assert kind == 6
            (n,) = reader.numbers("i")
            assert [reader.text() for _ in range(n)] == ["R", "G", "B"]
            x, y, width, height = reader.numbers("iiii")
            offsets, strides = reader.numbers(f"{n}q"), reader.numbers(f"{n}q")
            data = np.frombuffer(reader.rest(), "<f4")
            last = [o + (width * height - 1) * s for o, s in zip(offsets, strides, strict=True)]
            assert len(data) == max(last) + 1
            for c in range(n):
                channel = data[offsets[c] :: strides[c]][: width * height]
                self.pictures[name][y : y + height, x : x + width, c] = channel.reshape(height, -1)
            self.updates.append((x, y, width, height))
        assert reader.at == len(reader.content)


@pytest.fixture
def tev() -> Iterator[FakeTev]:
    tev = FakeTev()
    yield tev
    tev.join(30.0)


def picture(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    return rng.random((height, width, 3), np.float32)


def test_tiles_that_changed_are_sent(tev: FakeTev, rng: np.random.Generator) -> None:
    display = Display(tev.address, "fur \u00fc")
    window = Window(3, 5, 40, 150, 64, 200)
    rgb, samples = picture(150, 40, rng), np.zeros((150, 40), np.uint32)
    samples[:100] = 1
    display.show(rgb, samples, window)
    rgb, samples = picture(150, 40, rng), samples.copy()
    samples[140, 7] = 1
    display.show(rgb, samples, window)
    display.close()
    tev.join(30.0)
    assert tev.updates == [(3, 5, 40, 64), (3, 69, 40, 64), (3, 133, 40, 22), (3, 133, 40, 22)]
    shown = tev.pictures["fur \u00fc"]
    assert shown.shape == (200, 64, 3)
    np.testing.assert_array_equal(shown[145, 10], rgb[140, 7])
    assert (shown[133:145, 3:43] == 0.0).all()  # without samples
    assert np.isnan(shown[:5]).all()


def test_a_render_is_shown(tev: FakeTev, device: Device) -> None:
    image = furcl.render(decode_scene(SCENE), device=device, display=tev.address, wave_size=256)
    tev.join(30.0)
    np.testing.assert_array_equal(tev.pictures["patch (furcl)"], image.rgb)
    assert len(tev.updates) >= 2


def test_a_lost_display_is_named_once(
    device: Device, rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("WARNING", logger="furcl")
    tev = FakeTev(most=1)
    display = Display(tev.address, "large")
    rgb = picture(1024, 1024, rng)
    for i in range(1, 20):
        samples = np.full((1024, 1024), i, np.uint32)
        display.show(rgb, samples, Window(0, 0, 1024, 1024, 1024, 1024))
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    caplog.clear()
    tev.join(30.0)
    image = furcl.render(decode_scene(SCENE), device=device, display=tev.address)
    assert image.stats["complete"]
    assert len(caplog.records) == 1


@pytest.mark.parametrize("address", ["", "host", "host:", ":1", "host:0", "host:65536", "host:x"])
def test_wrong_addresses_are_refused(address: str, device: Device) -> None:
    with pytest.raises(ImageError, match="HOST:PORT"):
        furcl.render(decode_scene(SCENE), device=device, display=address)
