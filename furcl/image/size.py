"""How large a picture may be."""

from __future__ import annotations

from collections.abc import Iterator

from furcl.errors import ImageError

# Pictures are converted and written in strips of about so many pixels: what that takes beside the
# picture does not grow with it.
STRIP_PIXELS = 1 << 18

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


def strips(height: int, width: int) -> Iterator[slice]:
    """Rows of a picture, cut into strips of about STRIP_PIXELS; all but the last have an even
    number of rows."""
    rows = max(STRIP_PIXELS // max(width, 1) // 2 * 2, 2)
    for start in range(0, height, rows):
        yield slice(start, min(start + rows, height))
