"""The header of an OpenEXR file, read and checked before the OpenEXR library sees the file.

The library allocates what a header claims; here the claim is compared with the file and the memory.

Source: the OpenEXR file layout document.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from furcl.errors import ImageError
from furcl.image.size import check_size
from furcl.memory import require_memory
from furcl.values import shown

Bytes = bytes | mmap.mmap

MAGIC = b"\x76\x2f\x31\x01"

# Bits of the version.
TILED, DEEP, SEVERAL_PARTS = 0x200, 0x800, 0x1000

# Bytes of a pixel in a channel, by the number of its type.
_TYPE_BYTES = {0: 4, 1: 2, 2: 4}

# Types of attributes that are numbers, as struct has them.
_NUMBERS = {"int": "<i", "float": "<f", "double": "<d", "chromaticities": "<8f", "envmap": "B"}
_ENVMAPS = ("ENVMAP_LATLONG", "ENVMAP_CUBE")

# The most that pixels can shrink, by the number of the compression: what files of one colour do,
# and for deflate what it can.
_RATIOS = {0: 1, 1: 64, 2: 1032, 3: 1032, 4: 512, 5: 1376, 6: 4, 7: 16, 8: 1 << 16, 9: 1 << 16}
_OTHER_RATIO = 1 << 17

# Most of a page of header and chunk for files of a few pixels.
_SLACK_BYTES = 1 << 16


@dataclass(frozen=True)
class Channel:
    """What a header says of a channel.

    Attributes
    ----------
    name : str
    n_bytes : int           bytes of a pixel
    sampling : (x, y)       every how many columns and rows it has a pixel
    """

    name: str
    n_bytes: int
    sampling: tuple[int, int]


@dataclass(frozen=True)
class Box:
    """Pixels from (left, top) to (right, bottom), both within."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Columns."""
        return self.right - self.left + 1

    @property
    def height(self) -> int:
        """Rows."""
        return self.bottom - self.top + 1


@dataclass(frozen=True)
class Part:
    """The header of one part of a file.

    Attributes
    ----------
    attributes : dict       name -> bytes of the value
    types : dict            name -> type of the value
    end : int               where the header ends in the file
    """

    attributes: dict[str, bytes]
    types: dict[str, str]
    end: int

    @property
    def compression(self) -> int:
        """Number of the compression."""
        return self.attributes["compression"][0]

    @property
    def data_window(self) -> Box:
        """The pixels that the file holds."""
        return Box(*struct.unpack("<4i", self.attributes["dataWindow"]))

    @property
    def display_window(self) -> Box:
        """The pixels of the whole picture."""
        return Box(*struct.unpack("<4i", self.attributes["displayWindow"]))

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """All channels."""
        return tuple(_channels(self.attributes["channels"]))

    def pixel_bytes(self) -> int:
        """Bytes of a pixel, all channels together."""
        return sum(channel.n_bytes for channel in self.channels)

    def values(self) -> dict[str, Any]:
        """The attributes of simple types: texts, numbers, chromaticities, and envmap as a name."""
        found = {}
        for name, data in self.attributes.items():
            kind = self.types[name]
            if kind == "string":
                found[name] = data.decode("utf-8", "replace")
            elif kind in _NUMBERS and len(data) == struct.calcsize(_NUMBERS[kind]):
                numbers = struct.unpack(_NUMBERS[kind], data)
                found[name] = numbers[0] if len(numbers) == 1 else numbers
            if kind == "envmap" and name in found:
                number = found[name]
                found[name] = _ENVMAPS[number] if number < len(_ENVMAPS) else f"envmap {number}"
        return found


def parts_of(data: Bytes) -> list[Part]:
    """The headers of all parts.

    Raises
    ------
    ValueError      if they cannot be followed
    """
    try:
        several = version_of(data) & SEVERAL_PARTS
        parts, at = [_part(data, 8)], 0
        while several:
            at = parts[-1].end
            if not data[at]:
                break
            parts.append(_part(data, at))
        for part in parts:
            _ = part.compression, part.data_window, part.display_window, part.channels
    except (struct.error, IndexError, KeyError) as error:
        raise ValueError(f"the header is damaged at {error}") from None
    return parts


def version_of(data: Bytes) -> int:
    """The word after the magic number: version and what kind of file it is."""
    (version,) = struct.unpack_from("<I", data, 4)
    return version


def check_claims(path: Path, data: Bytes) -> Part:
    """The header of the first part, of a file that can hold what its headers claim.

    Raises
    ------
    ImageError      a header that cannot be followed, deep data, subsampled channels, more pixels
                    than are read, than fit into the memory, or than so many bytes can hold
    """
    try:
        parts = parts_of(data)
        version = version_of(data)
    except ValueError as error:
        raise ImageError(f"{path}: damaged or unsupported OpenEXR file: {error}") from None
    if version & DEEP:
        raise ImageError(f"{path}: holds deep pixels, which are not read; flatten the picture")
    uneven = [c for c in parts[0].channels if c.sampling != (1, 1)]
    if uneven:
        columns, rows = uneven[0].sampling
        raise ImageError(
            f"{path}: the channel {shown(uneven[0].name)} is subsampled, {columns} x {rows}; save "
            f"a flat RGB image"
        )
    decoded = 0
    for part in parts:
        for name, box in (("data", part.data_window), ("display", part.display_window)):
            check_size(f"{path}: the {name} window", box.height, box.width)
        n_bytes = part.data_window.width * part.data_window.height * part.pixel_bytes()
        decoded += n_bytes
        ratio = _RATIOS.get(part.compression, _OTHER_RATIO)
        if n_bytes > ratio * len(data) + _SLACK_BYTES:
            raise ImageError(
                f"{path}: damaged OpenEXR file: claims {part.data_window.width} x "
                f"{part.data_window.height} pixels of {part.pixel_bytes()} bytes; its {len(data)} "
                f"bytes cannot hold them; copy or render it again"
            )
    window = parts[0].display_window
    decoded += 4 * len(parts[0].channels) * (window.width * window.height)
    require_memory(path, n_bytes=4 * decoded, error=ImageError)
    return parts[0]


def _part(data: Bytes, at: int) -> Part:
    """A header; it ends with an empty name."""
    attributes: dict[str, bytes] = {}
    types: dict[str, str] = {}
    while data[at]:
        name, at = _word(data, at)
        types[name], at = _word(data, at)
        (n_bytes,) = struct.unpack_from("<I", data, at)
        if at + 4 + n_bytes > len(data):
            raise ValueError(f"attribute {name!r} reaches beyond the end of the file")
        attributes[name] = data[at + 4 : at + 4 + n_bytes]
        at += 4 + n_bytes
    return Part(attributes, types, at + 1)


def _word(data: Bytes, at: int) -> tuple[str, int]:
    """A text that ends with a zero, and where what follows begins."""
    end = data.find(b"\0", at)
    if end < 0:
        raise ValueError("a name has no end")
    return data[at:end].decode("latin-1"), end + 1


def _channels(listed: bytes) -> Iterator[Channel]:
    """What an attribute `channels` lists."""
    at = 0
    while at < len(listed) and listed[at]:
        name, at = _word(listed, at)
        kind, _, *sampling = struct.unpack_from("<4i", listed, at)
        yield Channel(name, _TYPE_BYTES[kind], (sampling[0], sampling[1]))
        at += 16
