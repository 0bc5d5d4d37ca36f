"""The chunks of an OpenEXR file, looked at before the OpenEXR library reads them.

The library writes to standard output and error what is wrong with the pixels of a file, and its
exception does not say it. Mostly a file was cut off: that is told here, in words.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

from furcl.image.exr_header import DEEP, SEVERAL_PARTS, TILED, Bytes, Part, version_of

# Rows of a chunk, by the number of the compression.
_ROWS = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}
NO, ZIPS, ZIP = 0, 2, 3

# What a file of scan lines begins with, with and without long names, and may call itself.
_VERSIONS = (2, 2 | 0x400)
_SCAN_LINES = b"scanlineimage"

# Of attributes that furcl writes; what the library says of others is not known.
_FAMILIAR = {
    "box2i", "chlist", "chromaticities", "compression", "double", "float", "int", "lineOrder",
    "string", "v2f",
}  # fmt: skip


def missing_part(data: Bytes, part: Part) -> str | None:
    """What a flat file of scan lines lacks; None if it is all there, or nothing can be said.

    Parameters
    ----------
    data : bytes        of the file
    part : Part         its only one
    """
    if not _is_flat(data, part):
        return None
    try:
        for _ in _chunks(data, part):
            pass
    except ValueError as error:
        return str(error)
    return None


def surely_whole(data: Bytes, part: Part) -> bool:
    """Whether the library will find nothing to complain of, so that it writes nothing.

    So it is in files of plain attributes whose pixels are not packed, or by zlib, which is undone
    here: its checksums hold. It takes as long as the library takes, and the memory of a chunk.
    """
    if part.compression not in (NO, ZIPS, ZIP) or not _is_flat(data, part):
        return False
    if not set(part.types.values()) <= _FAMILIAR or version_of(data) not in _VERSIONS:
        return False
    if part.attributes.get("type", _SCAN_LINES) != _SCAN_LINES:
        return False
    row_bytes = part.data_window.width * part.pixel_bytes()
    try:
        for channel in part.channels:
            channel.name.encode("ascii")
        for name, value in part.attributes.items():
            name.encode("ascii")
            if part.types[name] == "string":
                value.decode("utf-8")
        for n_rows, begin, n_bytes in _chunks(data, part):
            if not _unpacks(data[begin : begin + n_bytes], n_rows * row_bytes, part.compression):
                return False
    except (ValueError, zlib.error):
        return False
    return True


def _unpacks(packed: bytes, n_bytes: int, compression: int) -> bool:
    """Whether a chunk holds so many bytes; those that do not shrink are stored as they are."""
    if compression == NO or len(packed) == n_bytes:
        return len(packed) == n_bytes
    inflate = zlib.decompressobj()
    whole = len(inflate.decompress(packed, n_bytes + 1)) == n_bytes and inflate.eof
    return whole and not inflate.unused_data


def _is_flat(data: Bytes, part: Part) -> bool:
    """Whether chunks lie as they do in one part of scan lines."""
    flags = TILED | DEEP | SEVERAL_PARTS
    return part.compression in _ROWS and not version_of(data) & flags


def _chunks(data: Bytes, part: Part) -> Iterator[tuple[int, int, int]]:
    """Rows, first byte and number of bytes of every chunk; ValueError says what is missing."""
    rows, window = _ROWS[part.compression], part.data_window
    begins = range(window.top, window.bottom + 1, rows)
    table_end = part.end + 8 * len(begins)
    if table_end > len(data):
        raise ValueError("it ends before its pixels")
    for y, at in zip(begins, struct.unpack_from(f"<{len(begins)}Q", data, part.end), strict=True):
        if at == 0:
            raise ValueError(f"row {y} was never written")
        if at + 8 > len(data):
            raise ValueError(f"it ends before row {y}")
        found, n_bytes = struct.unpack_from("<iI", data, at)
        if found != y or at < table_end:
            raise ValueError(f"there is something else where row {y} should be")
        if at + 8 + n_bytes > len(data):
            raise ValueError(f"it ends within the {rows} rows from row {y}")
        yield min(rows, window.bottom + 1 - y), at + 8, n_bytes
