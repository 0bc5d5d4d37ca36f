"""Pictures of the colours of a mesh."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from furcl.errors import FurclError, ImageError
from furcl.files import named, open_regular
from furcl.image.colour import srgb_decode
from furcl.image.image import Image
from furcl.image.size import check_size, strips
from furcl.memory import require_memory

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

SUFFIXES = (".exr", ".png", ".jpg", ".jpeg")

#: What a pixel takes, and what it takes in Pillow.
PIXEL_BYTES, PILLOW_BYTES = 12, 4


def read_texture(path: str | os.PathLike[str]) -> NDArray[np.float32]:
    """The reflectances that a picture holds, row 0 on top.

    OpenEXR files hold them as they are; values of others are sRGB. Transparency is not used.

    Returns
    -------
    (H, W, 3) float32       linear, Rec.709, 0 to 1

    Raises
    ------
    ImageError      no such file, another format, damaged, or a value outside 0 to 1
    """
    path = named(path, ImageError)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ImageError(f"{path}: textures are read from {', '.join(SUFFIXES)} files; convert it")
    if suffix != ".exr":
        return _read_srgb(path)
    rgb = Image.load(path).rgb
    with np.errstate(invalid="ignore"):
        bad = ~((rgb >= 0.0) & (rgb <= 1.0)).all(axis=2)
    if bad.any():
        y, x = (int(i[0]) for i in np.nonzero(bad))
        raise ImageError(
            f"{path}: the pixel in row {y}, column {x} is {rgb[y, x].tolist()}; a reflectance is 0 "
            f"to 1; scale the picture"
        )
    return rgb


def _read_srgb(path: Path) -> NDArray[np.float32]:
    try:
        with open_regular(path) as file, _opened(file) as picture:
            check_size(f"{path}: its header", picture.height, picture.width)
            n_pixels = picture.height * picture.width
            if n_pixels > path.stat().st_size * _most_pixels_per_byte(picture):
                raise ValueError(
                    f"its header claims {picture.height} x {picture.width} pixels, its "
                    f"{path.stat().st_size} bytes cannot hold them"
                )
            require_memory(path, n_pixels * (PIXEL_BYTES + PILLOW_BYTES), ImageError)
            return _decoded(picture)
    except (FurclError, MemoryError):
        raise
    except Exception as error:  # whatever a damaged file makes of Pillow
        said = getattr(error, "strerror", None) or error
        raise ImageError(
            f"{path}: is no picture that Pillow reads: {said!s:.200}; save it again"
        ) from None


def _opened(file: BinaryIO) -> ImageFile:
    """Not by Pillow.open, which tries all formats that there are, some by other programs, and whose
    limit of pixels is one of the process."""
    from PIL.JpegImagePlugin import JpegImageFile
    from PIL.PngImagePlugin import PngImageFile

    is_png = file.read(4) == b"\x89PNG"
    file.seek(0)
    return PngImageFile(file) if is_png else JpegImageFile(file)


def _most_pixels_per_byte(picture: ImageFile) -> int:
    """Of a file. PNG is packed by deflate, which makes at most 1032 bytes of one; JPEG takes more
    than a bit for each 8 x 8 pixels of a channel, even where its scans are progressive."""
    raw = str(picture.tile[0].args)
    bits = next((bits for bits in (1, 2, 4) if f";{bits}'" in f"{raw}'"), 8)
    return 1032 * 8 // bits


def _decoded(picture: ImageFile) -> NDArray[np.float32]:
    """The linear colours of a picture, by strips."""
    deep = picture.mode.startswith("I")  # 16 bits, grey
    n = 65536 if deep else 256
    table = srgb_decode(np.arange(n) / (n - 1)).astype(np.float32)
    rgb = np.empty((picture.height, picture.width, 3), np.float32)
    for rows in strips(picture.height, picture.width):
        part = picture.crop((0, rows.start, picture.width, rows.stop))
        if deep:
            rgb[rows] = table[np.asarray(part)][:, :, None]
        else:
            rgb[rows] = table[np.asarray(part.convert("RGB"))]
    return rgb
