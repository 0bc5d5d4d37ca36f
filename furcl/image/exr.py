"""OpenEXR files as flat channels."""

from __future__ import annotations

import mmap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.files import named, open_regular
from furcl.image.colour import REC709, to_rec709
from furcl.image.exr_chunks import missing_part, surely_whole
from furcl.image.exr_decode import decode, decode_apart
from furcl.image.exr_header import MAGIC, Part, check_claims
from furcl.image.size import Window
from furcl.values import shown

# Larger files are decoded by a process of their own, which starts sooner than they are looked
# through.
LOOKED_THROUGH_BYTES = 8 << 20

# What float64 copies are made of.
ROWS_AT_ONCE = 64

# Channels of pictures whose Y is not grey: luminance with chroma, and XYZ.
_WITH_Y = ({"RY", "BY"}, {"X", "Z"})


def read_exr(path: str | Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """Channels and header of the first part of an OpenEXR file.

    Channels cover the display window; outside the data window they are 0. What a header claims is
    compared with the file and the memory before anything is decoded, which takes at most four times
    the decoded size, and writes nothing to standard output or error (furcl.image.exr_decode).

    Returns
    -------
    channels : dict     name -> (H, W) float32
    header : dict       texts, numbers, chromaticities and envmap

    Raises
    ------
    ImageError          if the file is missing, no OpenEXR file or damaged, claims more than it can
                        hold or fits the memory, or has deep or subsampled channels
    """
    path = named(path, ImageError)
    part, whole = _checked(path)
    names = [channel.name for channel in part.channels]
    if not names:
        raise ImageError(f"{path}: has no channels; save a flat RGB image")
    shape = (part.data_window.height, part.data_window.width)
    try:
        if whole:
            planes = np.empty((len(names), *shape), np.float32)
            decode(path, names, planes)
        else:
            planes = decode_apart(path, names, shape)
    except ValueError as error:
        raise ImageError(f"{path}: damaged or unsupported OpenEXR file: {error}") from None
    channels = {name: _placed(plane, part) for name, plane in zip(names, planes, strict=True)}
    return channels, part.values()


def _checked(path: Path) -> tuple[Part, bool]:
    """The first part's header, checked, and whether the file is small and known to be whole."""
    try:
        with open_regular(path) as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise ImageError(
                    f"{path}: does not start as an OpenEXR file does; give an .exr file"
                )
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                part = check_claims(path, data)
                missing = missing_part(data, part)
                if missing:
                    raise ImageError(
                        f"{path}: damaged OpenEXR file: {missing}; copy or render it again"
                    )
                window = part.data_window
                n_bytes = window.width * window.height * part.pixel_bytes()
                return part, n_bytes <= LOOKED_THROUGH_BYTES and surely_whole(data, part)
    except FileNotFoundError:
        raise ImageError(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        raise ImageError(f"{path}: cannot be read: {error.strerror}; check its rights") from None


def _placed(pixels: NDArray[np.float32], part: Part) -> NDArray[np.float32]:
    """Pixels of the data window as pixels of the display window."""
    data, display = part.data_window, part.display_window
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
            for row in range(0, len(rgb), ROWS_AT_ONCE):
                part = slice(row, row + ROWS_AT_ONCE)
                rgb[part] = rgb[part] @ matrix.T
        return rgb
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
