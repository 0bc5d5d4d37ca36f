"""Pictures that are taken for what they are not, or take more than they are."""

from __future__ import annotations

import os
import struct
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from faults.case import Case
from faults.harness import environment, refused, run
from furcl.errors import ImageError
from furcl.image.image import Image
from furcl.light.latlong import LatLong

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
# Published matrices to linear Rec.709. ACES: ACEScg to sRGB of the ACES project (colour-science
# lists it), of white D60 adapted to D65 by Bradford. ProPhoto: Lindbloom's RGB to XYZ at D50,
# Bradford D50 to D65, and XYZ to sRGB.
ACESCG = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
ACESCG_TO_REC709 = (
    (1.70505, -0.62179, -0.08326),
    (-0.13026, 1.14080, -0.01055),
    (-0.02400, -0.12897, 1.15297),
)
PROPHOTO = (0.7347, 0.2653, 0.1596, 0.8404, 0.0366, 0.0001, 0.3457, 0.3585)
PROPHOTO_TO_REC709 = (
    (2.03418, -0.72735, -0.30677),
    (-0.22881, 1.23174, -0.00293),
    (-0.00856, -0.15329, 1.16188),
)
PICTURE = np.random.default_rng(7).random((6, 12, 3)).astype(np.float32)


def write_exr(path: Path, pixels: np.ndarray, compression: str = "ZIP", **header) -> Path:
    """Write a picture by the OpenEXR package, with attributes."""
    import OpenEXR

    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    attributes = {"compression": kind, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(attributes, {"RGB": np.ascontiguousarray(pixels, np.float32)}) as file:
        file.write(str(path))
    return path


def write_hdr(path: Path, head: bytes, end: bytes = b"\n") -> Path:
    """A flat Radiance picture of 4 x 8 pixels, made of bytes."""
    pixels = np.random.default_rng(3).integers(128, 256, (4, 8, 4), np.uint8)
    pixels[..., 3] = 129
    lines = [b"#?RADIANCE", b"FORMAT=32-bit_rle_rgbe", *([head] if head else []), b"", b"-Y 4 +X 8"]
    path.write_bytes(b"".join(line + end for line in lines) + pixels.tobytes())
    return path


def hdr_values(path: Path) -> np.ndarray:
    """Its pixels by the format's definition."""
    data = np.frombuffer(path.read_bytes()[-4 * 32 :], np.uint8).reshape(4, 8, 4).astype(float)
    return (data[..., :3] + 0.5) * 2.0 ** (data[..., 3:] - 136)


def _close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> str:
    error = float(np.abs(found - expected).max())
    assert error <= tolerance, f"off by {error:.3g}, allowed is {tolerance:g}"
    return f"largest error {error:.1e}"


def _exr_primaries(primaries: tuple, matrix: tuple, folder: Path, quick: bool) -> str:
    path = write_exr(folder / "a.exr", PICTURE, chromaticities=primaries)
    return _close(Image.load(path).rgb, PICTURE @ np.array(matrix).T, 2e-3)


def _rec709(folder: Path, quick: bool) -> str:
    path = write_exr(folder / "a.exr", PICTURE, chromaticities=REC709)
    assert np.array_equal(Image.load(path).rgb, PICTURE)
    return "the same bits"


def _impossible(folder: Path, quick: bool) -> str:
    path = write_exr(folder / "a.exr", PICTURE, chromaticities=(0.3,) * 8)
    return refused(lambda: Image.load(path), ImageError, "chromaticities")


def _hdr_primaries(folder: Path, quick: bool) -> str:
    text = b"PRIMARIES= " + " ".join(map(str, PROPHOTO)).encode()
    path = write_hdr(folder / "a.hdr", text)
    expected = hdr_values(path) @ np.array(PROPHOTO_TO_REC709).T
    from furcl.image.hdr import read_hdr

    return _close(read_hdr(path), expected, 2e-3 * float(hdr_values(path).max()))


def _cube(folder: Path, quick: bool) -> str:
    import OpenEXR

    path = write_exr(folder / "a.exr", PICTURE, envmap=OpenEXR.ENVMAP_CUBE)
    said = refused(lambda: LatLong.load(path), ImageError, "ENVMAP_CUBE")
    whole = write_exr(folder / "b.exr", PICTURE, envmap=OpenEXR.ENVMAP_LATLONG)
    assert np.array_equal(LatLong.load(whole).texels, PICTURE)
    return said


def _window(folder: Path, quick: bool) -> str:
    """Two columns of the picture are outside its window, and rows of the window are missing."""
    window = (np.array([0, 0], np.int32), np.array([7, 7], np.int32))
    data = (np.array([-2, 1], np.int32), np.array([9, 6], np.int32))
    path = write_exr(folder / "a.exr", PICTURE, displayWindow=window, dataWindow=data)
    expected = np.zeros((8, 8, 3), np.float32)
    expected[1:7] = PICTURE[:, 2:10]
    for found in (Image.load(path).rgb, LatLong.load(path).texels):
        assert np.array_equal(found, expected)
    return "read, black outside"


def _luminance_chroma(folder: Path, quick: bool) -> str:
    import OpenEXR

    planes = {name: PICTURE[..., i].copy() for i, name in enumerate(("Y", "RY", "BY"))}
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, planes) as file:
        file.write(str(folder / "a.exr"))
    return refused(lambda: Image.load(folder / "a.exr"), ImageError, "BY, RY, Y")


def _hdr_form(name: str, end: bytes, folder: Path, quick: bool) -> str:
    path = write_hdr(folder / name, b"EXPOSURE=1.0", end)
    assert np.allclose(LatLong.load(path).texels, hdr_values(path), rtol=1e-6, atol=0)
    return "read"


def _huge(folder: Path, quick: bool) -> str:
    pixels = PICTURE.copy()
    pixels[2, 3] = 1e25
    path = write_exr(folder / "a.exr", pixels)
    return refused(lambda: LatLong.load(path), ImageError, "column 3, row 2", "1e+25")


def _many_digits(folder: Path, quick: bool) -> str:
    path = folder / "a.hdr"
    path.write_bytes(b"#?RADIANCE\n\n-Y " + b"9" * 4400 + b" +X 2\n" + bytes(64))
    return refused(lambda: LatLong.load(path), ImageError, "expected a size")


def _bomb(compression: str, folder: Path, quick: bool) -> str:
    """A small file whose header claims a picture that fills the memory."""
    path = write_exr(folder / "a.exr", np.zeros((8, 8, 3)), compression)
    data = path.read_bytes()
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = data.index(name) + len(name) + 4
        data = data[:at] + struct.pack("<4i", 0, 0, 16383, 7) + data[at + 16 :]
    path.write_bytes(data)
    read = (
        "import sys; from furcl.image.image import Image; from furcl.errors import ImageError\n"
        "try: Image.load(sys.argv[1])\nexcept ImageError as error: print(error)"
    )
    import sys

    ended = run([sys.executable, "-P", "-c", read, str(path)], environment())
    assert ended.code == 0, ended.err[-300:]
    assert ended.out, "accepted"
    n_decoded = 16384 * 8 * 12
    assert ended.peak_bytes <= 4 * n_decoded + 80e6, f"{ended.peak_bytes / 1e6:.0f} MB"
    what = f"{len(data)} bytes that claim {n_decoded / 1e6:.0f} MB"
    return f"{what}: refused in {ended.peak_bytes / 1e6:.0f} MB"


def _wide_claim(folder: Path, quick: bool) -> str:
    path = write_exr(folder / "a.exr", np.zeros((8, 8, 3)), "DWAA")
    data = path.read_bytes()
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = data.index(name) + len(name) + 4
        data = data[:at] + struct.pack("<4i", 0, 0, 20000, 12000) + data[at + 16 :]
    path.write_bytes(data)
    return refused(lambda: Image.load(path), ImageError, "cannot hold them")


def _two_threads(folder: Path, quick: bool) -> str:
    """Descriptors 1 and 2 are what they were, while and after two threads save and read."""
    before = [os.fstat(n)[:2] for n in (1, 2)]
    seen, stop = set(), threading.Event()

    def watch() -> None:
        while not stop.is_set():
            seen.add(tuple(os.fstat(n)[:2] for n in (1, 2)))

    def save(name: str) -> None:
        for _ in range(20 if quick else 500):
            Image(PICTURE).save(folder / name)
            Image.load(folder / name)

    watcher = threading.Thread(target=watch)
    watcher.start()
    savers = [threading.Thread(target=save, args=(f"{n}.exr",)) for n in range(2)]
    for thread in savers:
        thread.start()
    for thread in savers:
        thread.join()
    stop.set()
    watcher.join()
    assert seen == {tuple(before)}, f"descriptors changed: {seen}"
    return "descriptors 1 and 2 are never touched"


def _infinite_variance(folder: Path, quick: bool) -> str:
    from furcl.image.compare import z_scores

    variance = np.full_like(PICTURE, 1e-4)
    variance[0, 0] = np.inf
    found = z_scores(Image(PICTURE, variance), Image(PICTURE))
    assert found.n == PICTURE.size - 3, f"{found.n} values of {PICTURE.size - 3}"
    return "left out of z"


_RUNS: dict[str, Callable[[Path, bool], str]] = {
    "EXR in ACEScg (D60)": partial(_exr_primaries, ACESCG, ACESCG_TO_REC709),
    "EXR in ProPhoto (D50)": partial(_exr_primaries, PROPHOTO, PROPHOTO_TO_REC709),
    "EXR that says Rec.709": _rec709,
    "EXR with impossible chromaticities": _impossible,
    "HDR with PRIMARIES (D50)": _hdr_primaries,
    "EXR that is a cube": _cube,
    "EXR of a part of its window": _window,
    "EXR of luminance and chroma": _luminance_chroma,
    "HDR with CR LF": partial(_hdr_form, "a.hdr", b"\r\n"),
    "HDR called .rgbe": partial(_hdr_form, "a.rgbe", b"\n"),
    "HDR called .rad": partial(_hdr_form, "a.rad", b"\n"),
    "light of 1e25": _huge,
    "infinite variances compared": _infinite_variance,
    "HDR with a size of 4400 digits": _many_digits,
    "EXR that claims 240 million pixels": _wide_claim,
    "EXR bomb, DWAA": partial(_bomb, "DWAA"),
    "EXR bomb, PIZ": partial(_bomb, "PIZ"),
    "two EXRs saved in two threads": _two_threads,
}
CASES = [Case(name, run_one) for name, run_one in _RUNS.items()]
