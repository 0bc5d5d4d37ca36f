"""Pictures for tev while they render, by its protocol of packets over TCP.

Source: tev's include/tev/Ipc.h. A packet is its length in bytes as uint32, itself included, a type
as one byte, and values: one byte for a truth, int32, int64 and float32 little endian, texts that
end with a zero. Used are 4, CreateImage, and 6, UpdateImageV3, whose channels are interleaved.
"""

from __future__ import annotations

import logging
import socket
import struct
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.image.size import Window
from furcl.values import shown

log = logging.getLogger(__name__)

CREATE_IMAGE = 4
UPDATE_IMAGE_V3 = 6
CHANNELS = ("R", "G", "B")
#: A display that takes nothing for so long is lost [s].
PATIENCE_S = 5.0
#: Rows of a tile.
TILE_ROWS = 64


def packet(kind: int, *values: bytes) -> bytes:
    """A packet of a type; it asks for no focus."""
    body = bytes([kind, 0]) + b"".join(values)
    return struct.pack("<I", 4 + len(body)) + body


def create_image(name: str, width: int, height: int) -> bytes:
    """A packet that makes an empty picture of R, G, B; one of that name is replaced."""
    names = (_text(channel) for channel in CHANNELS)
    size = struct.pack("<iii", width, height, len(CHANNELS))
    return packet(CREATE_IMAGE, _text(name), size, *names)


def update_image(name: str, x: int, y: int, rgb: NDArray[np.float32]) -> bytes:
    """A packet with the pixels (H, W, 3) of a picture from column x and row y on."""
    height, width, n = rgb.shape
    return packet(
        UPDATE_IMAGE_V3,
        _text(name),
        struct.pack("<i", n),
        *(_text(channel) for channel in CHANNELS),
        struct.pack("<iiii", x, y, width, height),
        np.arange(n, dtype="<i8").tobytes(),  # offsets of the channels
        np.full(n, n, "<i8").tobytes(),  # and from pixel to pixel
        np.ascontiguousarray(rgb, "<f4").tobytes(),
    )


def _text(text: str) -> bytes:
    return text.replace("\0", "").encode() + b"\0"


class Display:
    """A picture at a tev. One that is lost is named once in the log, and nothing is sent any more.

    Parameters
    ----------
    address : str       HOST:PORT
    name : str          of the picture there

    Raises
    ------
    ImageError          another address
    """

    def __init__(self, address: str, name: str) -> None:
        self._address, self._name = address, name
        self._host, self._port = parse_address(address)
        self._socket: socket.socket | None = None
        self._lost = False
        self._samples: NDArray[np.uint32] | None = None

    def show(self, rgb: NDArray[np.float32], samples: NDArray[np.uint32], window: Window) -> None:
        """Send those tiles of a picture (H, W, 3) that have more samples (H, W) than when they were
        sent last."""
        if self._lost:
            return
        try:
            if self._socket is None:
                self._socket = socket.create_connection((self._host, self._port), PATIENCE_S)
                created = create_image(self._name, window.full_width, window.full_height)
                self._socket.sendall(created)
            for rows in self._changed(samples):
                tile = np.where((samples[rows] > 0)[..., None], rgb[rows], np.float32(0.0))
                at = window.left, window.top + rows.start
                self._socket.sendall(update_image(self._name, *at, tile))
            self._samples = samples
        except OSError as error:
            log.warning(
                "--display %s: %s; the render goes on without it",
                self._address,
                error.strerror or error,
            )
            self._lost = True
            self.close()

    def close(self) -> None:
        """End the connection; the picture stays there."""
        if self._socket:
            self._socket.close()
            self._socket = None

    def _changed(self, samples: NDArray[np.uint32]) -> Iterator[slice]:
        for top in range(0, len(samples), TILE_ROWS):
            rows = slice(top, min(top + TILE_ROWS, len(samples)))
            if self._samples is None or (samples[rows] != self._samples[rows]).any():
                yield rows


def parse_address(address: str) -> tuple[str, int]:
    """Host and port of HOST:PORT.

    Raises
    ------
    ImageError
    """
    host, colon, port = address.rpartition(":")
    if not (host and colon and port.isdecimal() and len(port) <= 5 and 0 < int(port) < 65536):
        raise ImageError(
            f"display {shown(address)}: expected HOST:PORT, for example 127.0.0.1:14158, where tev "
            f"listens"
        )
    return host.strip("[]"), int(port)
