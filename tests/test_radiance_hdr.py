"""Radiance pictures, read from bytes that the tests build."""

from __future__ import annotations

import numpy as np
import pytest

from furcl.errors import ImageError
from furcl.image.hdr import read_hdr
from furcl.light.latlong import LatLong

HEAD = b"#?RADIANCE\n# made by a test\nFORMAT=32-bit_rle_rgbe\n"


def quads(height=6, width=12):
    """RGBE pixels (H, W, 4) with runs in them, normalised as Radiance writes them."""
    rng = np.random.default_rng(3)
    pixels = rng.integers(0, 256, (height, width, 4), np.uint8)
    pixels[..., 0] |= 128
    pixels[..., 3] = rng.integers(120, 136, (height, width))
    if height > 3:
        pixels[1, width // 4 : 3 * width // 4] = pixels[1, width // 4]
        pixels[2] = pixels[2, 0]
        pixels[3, width // 2] = 0
    return pixels


def decoded(pixels):
    """Real values by the definition, one pixel at a time."""
    flat = [
        [0.0] * 3 if e == 0 else [(int(m) + 0.5) * 2.0 ** (int(e) - 136) for m in rgb]
        for *rgb, e in pixels.reshape(-1, 4)
    ]
    return np.array(flat).reshape(*pixels.shape[:2], 3)


def flat(pixels) -> bytes:
    return pixels.tobytes()


def old_runs(pixels) -> bytes:
    """Repeats as 1, 1, 1, n; counts above 255 as a low and a high byte."""
    out = bytearray()
    for line in pixels:
        at = 0
        while at < len(line):
            n = 1
            while at + n < len(line) and (line[at + n] == line[at]).all():
                n += 1
            out += line[at].tobytes()
            more = n - 1
            while more:
                out += bytes([1, 1, 1, more & 255])
                more >>= 8
            at += n
    return bytes(out)


def new_runs(pixels) -> bytes:
    """Each plane of a line by itself: 128 + n and a byte, or n and n bytes."""
    out = bytearray()
    for line in pixels:
        out += bytes([2, 2, len(line) >> 8, len(line) & 255])
        for plane in line.T:
            at = 0
            while at < len(plane):
                n = 1
                while at + n < len(plane) and n < 127 and plane[at + n] == plane[at]:
                    n += 1
                if n > 2:
                    out += bytes([128 + n, plane[at]])
                    at += n
                else:
                    chunk = plane[at : at + 5]
                    out += bytes([len(chunk)]) + chunk.tobytes()
                    at += len(chunk)
    return bytes(out)


def write(tmp_path, body: bytes, size: bytes = b"-Y 6 +X 12", head: bytes = HEAD):
    path = tmp_path / "a.hdr"
    path.write_bytes(head + b"\n" + size + b"\n" + body)
    return path


@pytest.mark.parametrize("coding", [flat, old_runs, new_runs])
def test_codings(tmp_path, coding):
    pixels = quads()
    found = read_hdr(write(tmp_path, coding(pixels)))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, decoded(pixels), rtol=1e-6)


@pytest.mark.parametrize("coding", [old_runs, new_runs])
def test_long_runs(tmp_path, coding):
    pixels = np.tile(quads(2, 1), (1, 1000, 1))
    found = read_hdr(write(tmp_path, coding(pixels), b"-Y 2 +X 1000"))
    np.testing.assert_allclose(found, decoded(pixels), rtol=1e-6)


def test_narrow_pictures_are_never_new_runs(tmp_path):
    pixels = quads(4, 7)
    pixels[0, 0] = (2, 2, 0, 130)
    found = read_hdr(write(tmp_path, flat(pixels), b"-Y 4 +X 7"))
    np.testing.assert_allclose(found, decoded(pixels), rtol=1e-6)


@pytest.mark.parametrize(
    ("size", "turn"),
    [
        (b"-Y 6 +X 12", lambda p: p),
        (b"+Y 6 +X 12", lambda p: p[::-1]),
        (b"-Y 6 -X 12", lambda p: p[:, ::-1]),
        (b"+Y 6 -X 12", lambda p: p[::-1, ::-1]),
        (b"+X 6 -Y 12", lambda p: p.swapaxes(0, 1)),
        (b"-X 6 +Y 12", lambda p: p.swapaxes(0, 1)[::-1, ::-1]),
    ],
)
def test_orientations(tmp_path, size, turn):
    pixels = quads()
    found = read_hdr(write(tmp_path, new_runs(pixels), size))
    np.testing.assert_allclose(found, turn(decoded(pixels)), rtol=1e-6)


def test_exposures_are_divided_out(tmp_path):
    head = HEAD + b"EXPOSURE=2\nEXPOSURE= 4.0\nCOLORCORR=1 2 4\n"
    found = read_hdr(write(tmp_path, flat(quads()), head=head))
    np.testing.assert_allclose(found, decoded(quads()) / [8.0, 16.0, 32.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"P6 1 1", "does not start with #"),
        (HEAD, "the header has no end"),
        (HEAD + b"\n-Y 6 -Y 12\n", "expected a size such as -Y 512"),
        (HEAD + b"\nhello\n", "the line after the header is b'hello'"),
        (HEAD + b"\n-Y 6 +X 12", "expected a size such as -Y 512"),
        (HEAD + b"\n-Y 40000 +X 2\n", "claims 40000 x 2 pixels"),
        (HEAD + b"\n-Y 32768 +X 32768\n", "claims 32768 x 32768 pixels"),
        (HEAD + b"\n-Y 6 +X 0\n", "claims 6 x 0 pixels"),
        (HEAD.replace(b"rgbe", b"xyze") + b"\n-Y 6 +X 12\n", "only 32-bit_rle_rgbe is read"),
        (HEAD + b"EXPOSURE=none\n\n-Y 6 +X 12\n", "is not positive numbers"),
        (HEAD + b"COLORCORR=1 1\n\n-Y 6 +X 12\n", "is not positive numbers"),
        (HEAD + b"\n-Y 6 +X 12\n", "0 bytes cannot hold 6 scanlines"),
        (HEAD + b"\n-Y 6 +X 12\n" + flat(quads())[:-1], "scanline 5 is cut short"),
        (HEAD + b"\n-Y 6 +X 12\n" + new_runs(quads())[:-1], "scanline 5 is cut short"),
        (HEAD + b"\n-Y 1 +X 12\n\x02\x02\x00\x0d\x00", "scanline 0 has another width"),
        (HEAD + b"\n-Y 1 +X 12\n\x02\x02\x00\x0c\xff\x00", "scanline 0 has a run beyond its end"),
        (HEAD + b"\n-Y 1 +X 12\n\x02\x02\x00\x0c\x00\x00", "scanline 0 has an empty run"),
        (HEAD + b"\n-Y 1 +X 4\n\x01\x01\x01\x04", "scanline 0 has a run without a pixel"),
        (HEAD + b"\n-Y 1 +X 4\n\x80\x80\x80\x80\x01\x01\x01\x09", "or beyond its end"),
    ],
)
def test_bad_files(tmp_path, content, message):
    path = tmp_path / "bad.hdr"
    path.write_bytes(content)
    with pytest.raises(ImageError, match=message) as caught:
        read_hdr(path)
    assert "bad.hdr: " in str(caught.value)


def test_a_missing_file(tmp_path):
    with pytest.raises(ImageError, match="there is no such file"):
        read_hdr(tmp_path / "none.hdr")


def test_a_light_image_may_be_one(tmp_path):
    image = LatLong.load(write(tmp_path, new_runs(quads())), scale=2.0)
    np.testing.assert_allclose(image.texels, 2.0 * decoded(quads()), rtol=1e-6)
