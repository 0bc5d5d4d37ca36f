"""OpenEXR files as flat channels."""

from __future__ import annotations

import mmap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.files import named
from furcl.image.colour import REC709, to_rec709
from furcl.image.exr_chunks import missing_part
from furcl.image.exr_header import MAGIC, Part, check_claims
from furcl.image.size import Window
from furcl.values import shown

# Channels of pictures whose Y is not grey: luminance with chroma, and XYZ.
_WITH_Y = ({"RY", "BY"}, {"X", "Z"})


def read_exr(path: str | Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Channels and header of the first part of an OpenEXR file.

    Channels cover the display window; outside the data window they are 0. What a header claims is
    compared with the file and the memory before anything is decoded, which takes at most four times
    the decoded size. Where compressed pixels are damaged, the OpenEXR library writes a line to
    standard error. It is left there: keeping it away would redirect the standard error of all
    threads.

    Returns
    -------
    channels : dict     name -> (H, W) float32
    header : dict       attributes as the OpenEXR package gives them

    Raises
    ------
    ImageError          if the file is missing, no OpenEXR file or damaged, claims more than it can
                        hold or fits the memory, or has deep or subsampled channels
    """
    import OpenEXR

    path = named(path, ImageError)
    if not path.is_file():
        raise ImageError(f"{path}: there is no such file; check the path")
    part, missing = _checked(path)
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
    return {name: _placed(pixels, part, path) for name, pixels in channels.items()}, header


def _checked(path: Path) -> tuple[Part, str | None]:
    """The first part's header, checked, and what the file lacks."""
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise ImageError(
                    f"{path}: does not start as an OpenEXR file does; give an .exr file"
                )
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                part = check_claims(path, data)
                return part, missing_part(data, part)
    except OSError as error:
        raise ImageError(f"{path}: cannot be read: {error.strerror}; check its rights") from None


def _placed(pixels: NDArray[np.float32], part: Part, path: Path) -> NDArray[np.float32]:
    """Pixels of the data window as pixels of the display window."""
    data, display = part.data_window, part.display_window
    if pixels.shape != (data.height, data.width):
        raise ImageError(f"{path}: its channels are subsampled; save a flat RGB image")
    if data == display:
        return pixels
    out = np.zeros((display.height, display.width), np.float32)
    left, right = max(data.left, display.left), min(data.right, display.right) + 1
    top, bottom = max(data.top, display.top), min(data.bottom, display.bottom) + 1
    if left < right and top < bottom:
        to, of = (
            (slice(top - box.top, bottom - box.top), slice(left - box.left, right - box.left))
            for box in (display, data)
        )
        out[to] = pixels[of]
    return out


def rgb_of(
    channels: Mapping[str, NDArray[np.float32]], header: Mapping[str, Any], path: str | Path
) -> NDArray[np.float32]:
    """The (H, W, 3) picture among channels in Rec.709: R, G, B, or Y alone as grey.

    Raises
    ------
    ImageError      other channels, or chromaticities that no colours have
    """
    if all(name in channels for name in "RGB"):
        rgb = np.stack([channels[name] for name in "RGB"], axis=2)
        matrix = to_rec709_of(header, path)
        if matrix is None:
            return rgb
        with np.errstate(invalid="ignore", over="ignore"):  # pixels that are not finite
            return np.asarray(rgb @ matrix.T, np.float32)
    if "Y" in channels and not any(names <= set(channels) for names in _WITH_Y):
        return np.repeat(channels["Y"][:, :, None], 3, axis=2)
    raise ImageError(
        f"{path}: has the channels {', '.join(sorted(channels))}; R, G and B (or Y) are needed"
    )


def to_rec709_of(header: Mapping[str, Any], path: str | Path) -> NDArray[np.float64] | None:
    """What turns a file's R, G, B into Rec.709 by its `chromaticities`; None if nothing does.

    Raises
    ------
    ImageError      as `rgb_of`
    """
    try:
        return to_rec709(header.get("chromaticities", REC709))
    except ValueError as error:
        raise ImageError(
            f"{path}: chromaticities = {shown(header['chromaticities'])}: {error}; correct the "
            f"header, or save the picture in Rec.709"
        ) from None


def write_exr(
    path: str | Path,
    channels: Mapping[str, NDArray[np.float32]],
    header: Mapping[str, Any],
    window: Window | None = None,
) -> None:
    """Write (H, W) float32 channels with ZIP compression and extra header attributes.

    Strings, int and float become attributes of these types. The channels R, G, B are Rec.709. A
    window becomes the data window, and the whole picture the display window.

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
    if window is not None:
        left, top, right, bottom = window.box
        attributes["dataWindow"] = _box(left, top, right, bottom)
        attributes["displayWindow"] = _box(0, 0, window.full_width, window.full_height)
    pixels = {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}
    try:
        with OpenEXR.File(attributes, pixels) as file:
            file.write(str(path))
    except Exception as error:
        raise ImageError(f"{path}: cannot be written: {error}; check folder and space") from None


def _box(left: int, top: int, right: int, bottom: int) -> tuple[Any, Any]:
    """A box of a header, which holds its last column and row."""
    return np.array([left, top], np.int32), np.array([right - 1, bottom - 1], np.int32)
