"""Reader of Radiance pictures (.hdr, .pic, .rgbe, .rad): flat, old and new run-length encoding."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from furcl.errors import ImageError
from furcl.files import named, open_regular
from furcl.image.colour import to_rec709
from furcl.image.size import check_size
from furcl.memory import require_memory

MAGIC = b"#?"
ROWS_AT_ONCE = 64
_RESOLUTION = re.compile(rb"^([+-])([XY]) +(\d{1,9}) +([+-])([XY]) +(\d{1,9})\r?$")
_HEADER_END = re.compile(rb"\n\r?\n")


def is_hdr(path: str | Path) -> bool:
    """Whether a file begins as Radiance pictures do."""
    try:
        with open_regular(path) as file:
            return file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError):
        return False


def read_hdr(path: str | Path) -> NDArray[np.float32]:
    """The picture as (H, W, 3) float32, row 0 on top, linear RGB.

    Mantissas count from the middle of their step, (m + 1/2) 2^(e - 136), as in Radiance itself;
    EXPOSURE and COLORCORR of the header are divided out, and PRIMARIES other than those of Rec.709
    are converted. Lines of the header may end in CR LF.

    Raises
    ------
    ImageError      if the file is missing, of another kind, in XYZ, damaged or too large; names
                    the byte or scanline

    Source: the format description in Ward, "Real pixels", Graphics Gems II, and the Radiance file
    formats document.
    """
    path = named(path, ImageError)
    try:
        with open_regular(path) as file:
            require_memory(path, n_bytes=2 * path.stat().st_size, error=ImageError)
            data = file.read()
    except FileNotFoundError:
        raise ImageError(f"{path}: there is no such file; check the path") from None
    except OSError as error:
        raise ImageError(f"{path}: cannot be read: {error.strerror}; check its rights") from None
    if not data.startswith(MAGIC):
        raise ImageError(
            f"{path}: does not start with #? as Radiance pictures do; give an .hdr file"
        )
    end = _HEADER_END.search(data)
    if end is None:
        raise ImageError(f"{path}: the header has no end (an empty line); the file is damaged")
    exposure, matrix = _header(data[: end.start()], path)
    stop = data.find(b"\n", end.end())
    line = data[end.end() : stop] if stop >= 0 else b""
    match = _RESOLUTION.match(line)
    if not match or match[2] == match[5]:
        raise ImageError(
            f"{path}: the line after the header is {line[:40]!r}; expected a size such as "
            f"-Y 512 +X 1024"
        )
    n_lines, n_pixels = int(match[3]), int(match[6])
    check_size(f"{path}:", n_lines, n_pixels)
    require_memory(path, n_bytes=32 * n_lines * n_pixels, error=ImageError)
    quads = _scanlines(np.frombuffer(data, np.uint8, offset=stop + 1), n_lines, n_pixels, path)
    if match[2] == b"X":
        quads = quads.transpose(1, 0, 2)
    y_sign, x_sign = (match[1], match[4]) if match[2] == b"Y" else (match[4], match[1])
    quads = quads[:: -1 if y_sign == b"+" else 1, :: -1 if x_sign == b"-" else 1]
    out = np.empty((*quads.shape[:2], 3), np.float32)
    for row in range(0, len(quads), ROWS_AT_ONCE):
        part = slice(row, row + ROWS_AT_ONCE)
        out[part] = _radiance(quads[part], exposure, matrix)
    return out


def _radiance(
    quads: NDArray[np.uint8], exposure: NDArray[np.float64], matrix: NDArray[np.float64] | None
) -> NDArray[np.float32]:
    """Mantissas and exponents (.., 4) as radiance (.., 3)."""
    exponent = quads[..., 3:].astype(np.int32)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused later
        rgb = np.ldexp(quads[..., :3] + 0.5, exponent - 136) / exposure
        rgb = np.where(exponent > 0, rgb, 0.0)
        return (rgb if matrix is None else rgb @ matrix.T).astype(np.float32)


def _header(text: bytes, path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """The product of exposures (3,), and what turns its colours into Rec.709; checks the format."""
    exposure, matrix = np.ones(3), None
    for line in text.splitlines()[1:]:
        key, _, value = line.partition(b"=")
        if key == b"PRIMARIES":
            try:
                matrix = to_rec709([float(word) for word in value.split()])
            except ValueError as error:
                raise ImageError(
                    f"{path}: header line {line[:80]!r}: {error}; correct it"
                ) from None
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
            wanted = 1 if key == b"EXPOSURE" else 3
            if len(numbers) != wanted or not np.all((numbers > 0.0) & np.isfinite(numbers)):
                raise ImageError(
                    f"{path}: header line {line[:60]!r} is not positive numbers; correct it"
                )
            with np.errstate(over="ignore", under="ignore"):
                exposure = exposure * numbers
    if not np.all((exposure > 0.0) & np.isfinite(exposure)):
        raise ImageError(f"{path}: its exposures multiply to {exposure.tolist()}; correct them")
    return exposure, matrix


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
