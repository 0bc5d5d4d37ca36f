"""How large a picture may be."""

from __future__ import annotations

from furcl.errors import ImageError

MAX_SIDE = 32768
MAX_PIXELS = 1 << 28


def check_size(where: str, height: int, width: int) -> None:
    """Refuse a picture without pixels, or with more than are read.

    Parameters
    ----------
    where : str     the file, and what in it is so large

    Raises
    ------
    ImageError
    """
    sides = min(height, width), max(height, width)
    if sides[0] < 1 or sides[1] > MAX_SIDE or height * width > MAX_PIXELS:
        raise ImageError(
            f"{where} claims {height} x {width} pixels; 1 to {MAX_SIDE} a side are read and "
            f"{MAX_PIXELS} in all"
        )
