"""Reader of Radiance pictures (.hdr, .pic): flat, old and new run-length encoding."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError

MAX_SIDE = 32768
MAX_PIXELS = 1 << 28
_RESOLUTION = re.compile(rb"^([+-])([XY]) +(\d+) +([+-])([XY]) +(\d+)$")


def read_hdr(path: str | Path) -> NDArray[np.float32]:
    """The picture as (H, W, 3) float32, row 0 on top, linear RGB.

    Mantissas count from the middle of their step, (m + 1/2) 2^(e - 136), as in Radiance itself;
    EXPOSURE and COLORCORR of the header are divided out.

    Raises
    ------
    ImageError      if the file is missing, of another kind, in XYZ, or damaged; names the byte or
                    scanline

    Source: the format description in Ward, "Real pixels", Graphics Gems II, and the Radiance file
    formats document.
    """
    path = Path(path)
    if not path.is_file():
        raise ImageError(f"{path}: there is no such file; check the path")
    data = path.read_bytes()
    if not data.startswith(b"#?"):
        raise ImageError(
            f"{path}: does not start with #? as Radiance pictures do; give an .hdr file"
        )
    end = data.find(b"\n\n")
    if end < 0:
        raise ImageError(f"{path}: the header has no end (an empty line); the file is damaged")
    exposure = _header(data[:end], path)
    stop = data.find(b"\n", end + 2)
    line = data[end + 2 : stop] if stop >= 0 else b""
    match = _RESOLUTION.match(line)
    if not match or match[2] == match[5]:
        raise ImageError(
            f"{path}: the line after the header is {line[:40]!r}; expected a size such as "
            f"-Y 512 +X 1024"
        )
    n_lines, n_pixels = int(match[3]), int(match[6])
    sides = min(n_lines, n_pixels), max(n_lines, n_pixels)
    if sides[0] < 1 or sides[1] > MAX_SIDE or n_lines * n_pixels > MAX_PIXELS:
        raise ImageError(
            f"{path}: claims {n_lines} x {n_pixels} pixels; 1 to {MAX_SIDE} a side are read and "
            f"{MAX_PIXELS} in all"
        )
    quads = _scanlines(np.frombuffer(data, np.uint8, offset=stop + 1), n_lines, n_pixels, path)
    if match[2] == b"X":
        quads = quads.transpose(1, 0, 2)
    y_sign, x_sign = (match[1], match[4]) if match[2] == b"Y" else (match[4], match[1])
    quads = quads[:: -1 if y_sign == b"+" else 1, :: -1 if x_sign == b"-" else 1]
    exponent = quads[..., 3:].astype(np.int32)
    rgb = np.ldexp(quads[..., :3] + 0.5, exponent - 136)
    return np.where(exponent > 0, rgb / exposure, 0.0).astype(np.float32)


def _header(text: bytes, path: Path) -> NDArray[np.float64]:
    """The product of exposures (3,), after a check of the format."""
    exposure = np.ones(3)
    for line in text.split(b"\n")[1:]:
        key, _, value = line.partition(b"=")
        if key == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise ImageError(
                f"{path}: FORMAT={value.decode('ascii', 'replace').strip()}; only "
                f"32-bit_rle_rgbe is read; "
                f"convert it (ra_xyze -r)"
            )
        if key in (b"EXPOSURE", b"COLORCORR"):
            try:
                numbers = np.array([float(word) for word in value.split()])
            except ValueError:
                numbers = np.zeros(0)
            if len(numbers) != (1 if key == b"EXPOSURE" else 3) or not np.all(numbers > 0.0):
                raise ImageError(
                    f"{path}: header line {line[:60]!r} is not positive numbers; correct it"
                )
            exposure = exposure * numbers
    return exposure


def _scanlines(
    data: NDArray[np.uint8], n_lines: int, n_pixels: int, path: Path
) -> NDArray[np.uint8]:
    if 2 * n_lines > len(data):
        raise ImageError(
            f"{path}: {len(data)} bytes cannot hold {n_lines} scanlines; it is cut short"
        )
    picture = np.empty((n_lines, n_pixels, 4), np.uint8)
    at = 0
    for line in range(n_lines):
        head = data[at : at + 4]
        runs = 8 <= n_pixels <= 32767 and len(head) == 4 and head[0] == 2 and head[1] == 2
        try:
            if runs and head[2] < 128:
                if (int(head[2]) << 8 | int(head[3])) != n_pixels:
                    raise ValueError("has another width than the picture")
                at = _new_runs(data, at + 4, picture[line])
            else:
                at = _old_runs(data, at, picture[line])
        except ValueError as error:
            raise ImageError(f"{path}: scanline {line} {error}; the file is damaged") from None
    return picture


def _new_runs(data: NDArray[np.uint8], at: int, out: NDArray[np.uint8]) -> int:
    """Decode one scanline of four separately coded planes; returns the next byte's place."""
    n_pixels = len(out)
    for plane in range(4):
        filled = 0
        while filled < n_pixels:
            if at + 2 > len(data):
                raise ValueError("is cut short")
            count = int(data[at])
            repeated = count > 128
            count = count - 128 if repeated else count
            used = 1 if repeated else count
            if count == 0 or filled + count > n_pixels:
                raise ValueError("has a run beyond its end" if count else "has an empty run")
            if at + 1 + used > len(data):
                raise ValueError("is cut short")
            out[filled : filled + count, plane] = data[at + 1 : at + 1 + used]
            filled += count
            at += 1 + used
    return at


def _old_runs(data: NDArray[np.uint8], at: int, out: NDArray[np.uint8]) -> int:
    """Decode one scanline of plain pixels in which 1, 1, 1, n repeats the last pixel n times."""
    n_pixels, filled, shift = len(out), 0, 0
    while filled < n_pixels:
        rest = data[at : at + 4 * (n_pixels - filled)]
        quads = rest[: len(rest) // 4 * 4].reshape(-1, 4)
        if not len(quads):
            raise ValueError("is cut short")
        markers = np.flatnonzero(np.all(quads[:, :3] == 1, axis=1))
        plain = int(markers[0]) if len(markers) else len(quads)
        if plain:
            out[filled : filled + plain] = quads[:plain]
            filled, shift = filled + plain, 0
        else:
            count = int(quads[0, 3]) << shift
            if filled == 0 or shift > 24 or filled + count > n_pixels:
                raise ValueError("has a run without a pixel or beyond its end")
            out[filled : filled + count] = out[filled - 1]
            filled, shift, plain = filled + count, shift + 8, 1
        at += 4 * plain
    return at
