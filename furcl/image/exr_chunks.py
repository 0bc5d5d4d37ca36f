"""Whether an OpenEXR file is all there, found before the OpenEXR library reads it.

The library writes to standard error what is wrong with the pixels of a file, and its exception does
not say it. Mostly a file was cut off: that is told here, in words, and the library is not asked.
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

MAGIC = b"\x76\x2f\x31\x01"

# Bits of the version that say: tiles, deep data, several parts. Their chunks lie otherwise.
_OTHER_LAYOUTS = 0x200 | 0x800 | 0x1000
# Rows of a chunk, by the number of the compression.
_ROWS = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}


def missing_part(path: Path) -> str | None:
    """What a flat file of scan lines lacks; None if it is all there, or nothing can be said.

    A header that cannot be read is left to the library, which refuses it without writing anything.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        try:
            attributes, table = _header(data)
            (version,) = struct.unpack_from("<I", data, 4)
            rows = _ROWS[attributes["compression"][0]]
            _, top, _, bottom = struct.unpack("<4i", attributes["dataWindow"])
        except (struct.error, IndexError, KeyError, ValueError):
            return None
        if version & _OTHER_LAYOUTS or bottom < top:
            return None
        begins = range(top, bottom + 1, rows)
        if table + 8 * len(begins) > len(data):
            return "it ends before its pixels"
        for y, at in zip(begins, struct.unpack_from(f"<{len(begins)}Q", data, table), strict=True):
            if at == 0:
                return f"row {y} was never written"
            if at + 8 > len(data):
                return f"it ends before row {y}"
            found, n_bytes = struct.unpack_from("<iI", data, at)
            if found != y:
                return f"there is something else where row {y} should be"
            if at + 8 + n_bytes > len(data):
                return f"it ends within the {rows} rows from row {y}"
    return None


def _header(data: mmap.mmap) -> tuple[dict[str, bytes], int]:
    """Attributes of the header as bytes, and where it ends: there the table of chunks begins."""
    attributes, at = {}, 8
    while data[at]:
        name, at = _word(data, at)
        _, at = _word(data, at)
        (n_bytes,) = struct.unpack_from("<I", data, at)
        attributes[name] = data[at + 4 : at + 4 + n_bytes]
        at += 4 + n_bytes
    return attributes, at + 1


def _word(data: mmap.mmap, at: int) -> tuple[str, int]:
    """A text that ends with a zero, and where what follows begins."""
    end = data.find(b"\0", at)
    if end < 0:
        raise ValueError("the text has no end")
    return data[at:end].decode("latin-1"), end + 1
