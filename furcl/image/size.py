"""How large a picture may be, and what part of it there is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from furcl.errors import ImageError

# Pictures are converted and written in strips of about so many pixels: what that takes beside the
# picture does not grow with it.
STRIP_PIXELS = 1 << 18

MAX_SIDE = 32768
MAX_PIXELS = 1 << 28


@dataclass(frozen=True)
class Window:
    """A part of a picture [pixels], from the top left.

    Attributes
    ----------
    left, top : int         its first column and row in the whole picture
    width, height : int
    full_width, full_height : int       of the whole picture
    """

    left: int
    top: int
    width: int
    height: int
    full_width: int
    full_height: int

    @property
    def n_pixels(self) -> int:
        """Pixels of the window."""
        return self.width * self.height

    @property
    def whole(self) -> bool:
        """Whether it is the whole picture."""
        return (self.width, self.height) == (self.full_width, self.full_height)

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Left, top, right and bottom; the last two are the first that are not in it."""
        return self.left, self.top, self.left + self.width, self.top + self.height


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
