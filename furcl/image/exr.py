"""OpenEXR files as flat channels."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.image.exr_chunks import MAGIC, missing_part

# Rec.709 primaries and white point D65 as the attribute `chromaticities` wants them.
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


def read_exr(path: str | Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Channels and header of the first part of an OpenEXR file.

    Where compressed pixels are damaged, the OpenEXR library writes a line to standard error. It is
    left there: keeping it away would redirect the standard error of all threads.

    Returns
    -------
    channels : dict     name -> (H, W) float32
    header : dict       attributes as the OpenEXR package gives them

    Raises
    ------
    ImageError          if the file is missing, no OpenEXR file or damaged, or has deep or
                        subsampled channels
    """
    import OpenEXR

    path = Path(path)
    if not path.is_file():
        raise ImageError(f"{path}: there is no such file; check the path")
    try:
        with path.open("rb") as file:
            begins = file.read(len(MAGIC))
        missing = missing_part(path) if begins == MAGIC else None
    except OSError as error:
        raise ImageError(f"{path}: cannot be read: {error.strerror}; check its rights") from None
    if begins != MAGIC:
        raise ImageError(f"{path}: does not start as an OpenEXR file does; give an .exr file")
    if missing:
        raise ImageError(f"{path}: damaged OpenEXR file: {missing}; copy or render it again")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            header = dict(file.header())
            channels = {
                name: np.asarray(channel.pixels, np.float32)
                for name, channel in file.channels().items()
            }
    except Exception as error:
        raise ImageError(f"{path}: damaged or unsupported OpenEXR file: {error}") from None
    if not channels or len({pixels.shape for pixels in channels.values()}) != 1:
        raise ImageError(f"{path}: has no channels of one common size; save a flat RGB image")
    return channels, header


def rgb_of(channels: Mapping[str, NDArray[np.float32]], path: str | Path) -> NDArray[np.float32]:
    """The (H, W, 3) picture among channels: R, G, B, or Y alone as grey."""
    if all(name in channels for name in "RGB"):
        return np.stack([channels[name] for name in "RGB"], axis=2)
    if "Y" in channels:
        return np.repeat(channels["Y"][:, :, None], 3, axis=2)
    raise ImageError(
        f"{path}: has the channels {', '.join(sorted(channels))}; R, G and B (or Y) are needed"
    )


def write_exr(
    path: str | Path, channels: Mapping[str, NDArray[np.float32]], header: Mapping[str, Any]
) -> None:
    """Write (H, W) float32 channels with ZIP compression and extra header attributes.

    Strings, int and float become attributes of these types. The channels R, G, B are Rec.709.

    Raises
    ------
    ImageError      if the file cannot be written
    """
    import OpenEXR

    attributes = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "chromaticities": REC709,
        **header,
    }
    pixels = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    try:
        with OpenEXR.File(attributes, pixels) as file:
            file.write(str(path))
    except Exception as error:
        raise ImageError(f"{path}: cannot be written: {error}; check folder and space") from None
