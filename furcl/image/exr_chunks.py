"""Whether an OpenEXR file is all there, found before the OpenEXR library reads it.

The library writes to standard error what is wrong with the pixels of a file, and its exception does
not say it. Mostly a file was cut off: that is told here, in words, and the library is not asked.
"""

from __future__ import annotations

import struct

from furcl.image.exr_header import DEEP, SEVERAL_PARTS, TILED, Bytes, Part, version_of

# Rows of a chunk, by the number of the compression.
_ROWS = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}


def missing_part(data: Bytes, part: Part) -> str | None:
    """What a flat file of scan lines lacks; None if it is all there, or nothing can be said.

    Parameters
    ----------
    data : bytes        of the file
    part : Part         its only one
    """
    rows = _ROWS.get(part.compression)
    # In other layouts chunks lie otherwise.
    if rows is None or version_of(data) & (TILED | DEEP | SEVERAL_PARTS):
        return None
    window = part.data_window
    begins = range(window.top, window.bottom + 1, rows)
    if part.end + 8 * len(begins) > len(data):
        return "it ends before its pixels"
    for y, at in zip(begins, struct.unpack_from(f"<{len(begins)}Q", data, part.end), strict=True):
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
