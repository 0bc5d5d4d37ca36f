"""Pictures of the colours of a mesh."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.files import named
from furcl.image.colour import srgb_decode
from furcl.image.image import Image
from furcl.image.size import check_size

SUFFIXES = (".exr", ".png", ".jpg", ".jpeg")


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
    rgb = Image.load(path).rgb if suffix == ".exr" else _read_srgb(path)
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
    from PIL import Image as Pillow

    try:
        with Pillow.open(path) as picture:
            check_size(f"{path}: its header", picture.height, picture.width)
            if picture.mode.startswith("I;16") or picture.mode == "I":
                grey = np.asarray(picture, np.float64) / 65535.0
                values = np.repeat(grey[:, :, None], 3, axis=2)
            else:
                values = np.asarray(picture.convert("RGB"), np.float64) / 255.0
    except (OSError, SyntaxError, ValueError, Pillow.DecompressionBombError) as error:
        raise ImageError(
            f"{path}: is no picture that Pillow reads: {error}; save it again"
        ) from None
    return srgb_decode(values).astype(np.float32)
