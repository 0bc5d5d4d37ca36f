"""The .data files of USC-HairSalon: binary, little endian."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from furcl.errors import GroomError
from furcl.groom.curves import ADVICE
from furcl.groom.formats.format import Asked, Format, Strands, mapped
from furcl.memory import require_memory


def read_data(path: Path, asked: Asked) -> Strands:
    """Read i32 strands, and of each i32 points and their x, y, z (f32).

    Strands of one point, which the data set has where nothing grows, are counted and left out.

    Raises
    ------
    GroomError      the byte offset and strand, and a remedy
    """
    data = mapped(path)
    size = len(data)
    if size < 8:
        raise GroomError(f"{path}: the file ends at byte {size}; it is cut off, fetch it again.")
    (n_strands,) = struct.unpack_from("<i", data, 0)
    if not 0 < n_strands <= size // 4:
        raise GroomError(
            f"{path}: byte 0 claims {n_strands} strands in {size} bytes; it is cut off, or no "
            ".data file of USC-HairSalon."
        )
    require_memory(path, n_bytes=4 * size, error=GroomError)
    counts = np.zeros(n_strands, np.int64)
    at = 4
    for strand in range(n_strands):
        count = struct.unpack_from("<i", data, at)[0] if at + 4 <= size else -1
        if count < 0 or at + 4 + 12 * count > size:
            raise GroomError(
                f"{path}: byte {at}: strand {strand} of {n_strands} has {count} points, in a file "
                f"of {size} bytes; it is cut off or damaged, fetch it again."
            )
        counts[strand] = count
        at += 4 + 12 * count
    if at != size:
        raise GroomError(
            f"{path}: {size - at} bytes too many: its {n_strands} strands end at byte {at} of "
            f"{size}. Is it a .data file of USC-HairSalon?"
        )
    if asked.default_radius is None:
        raise GroomError(f"{path}: files of USC-HairSalon have no radii. {ADVICE}")
    # What is left of the words of the file without the counts: points.
    words = np.ones(size // 4, bool)
    words[0] = False
    words[1 + 3 * np.cumsum(counts) - 3 * counts + np.arange(n_strands)] = False
    points = np.frombuffer(data, "<f4")[words].reshape(-1, 3)
    kept = counts > 1
    dropped = {"single_points": int(np.count_nonzero(~kept))}
    if not kept.all():
        points = points[np.repeat(kept, counts)]
    offsets = np.concatenate([[0], np.cumsum(counts[kept])])
    radius = np.float32(asked.default_radius)
    return Strands(points, radius, offsets, str(path), dropped=dropped)


FORMAT = Format(
    name="USC-HairSalon",
    suffixes=(".data",),
    read=read_data,
    write=None,
    about="The strands of the data set USC-HairSalon, binary.",
    points="as many points as a strand says",
    radius="none: `default_radius` (`--default-radius`)",
    units="says none; metres and y up in the data set (`--up y`)",
    left_out="strands of one point are counted",
)
