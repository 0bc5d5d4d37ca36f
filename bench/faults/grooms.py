"""Grooms: radii of 0, claims beyond the file, arrays of other shapes, names that are none."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from faults.case import Case
from faults.harness import furcl, refused, told
from furcl.errors import GroomError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves


def _strands(n: int, tip: float) -> Curves:
    """Upright strands of four points that taper to a radius."""
    rng = np.random.default_rng(5)
    roots = np.concatenate([rng.random((n, 1, 2)), np.zeros((n, 1, 1))], axis=2)
    points = roots + np.array([0.0, 0.0, 0.3]) * np.linspace(0.0, 1.0, 4)[:, None]
    return Curves.from_arrays(points, np.broadcast_to(np.linspace(0.02, tip, 4), (n, 4)))


def _tips(folder: Path, quick: bool) -> str:
    """Strands that taper to 0 render as those that taper to 1e-18, to the bit."""
    from furcl import load_scene, render

    scene = load_scene("single_fibre", size="24x24", spp=2 if quick else 16)
    pictures = [render(scene, curves=_strands(50, tip)) for tip in (0.0, 1e-18)]
    assert np.array_equal(pictures[0].rgb, pictures[1].rgb)
    assert np.isfinite(pictures[0].rgb).all()
    assert pictures[0].stats["nonfinite"] == 0
    return "the bits of radius 1e-18"


def _all_zero(suffix: str, folder: Path, quick: bool) -> str:
    """A groom whose every radius is 0: what its message advises mends it."""
    path = folder / f"a{suffix}"
    if suffix == ".npz":
        np.savez(path, points=np.eye(4)[:, :3], radii=np.zeros(4), counts=np.array([4]))
    else:
        header = b"HAIR" + struct.pack("<4I8f", 1, 4, 6, 3, 0, 0, 0, 0, 0, 0, 0, 0)
        points = np.eye(4, dtype="<f4")[:, :3]
        path.write_bytes(header[:40].ljust(128, b"\0") + points.tobytes() + bytes(16))
    refused(lambda: load_curves(path), GroomError, "--default-radius")
    for command in (("info", path), ("convert", path, folder / "b.npz")):
        told(furcl(*command), 2, "--default-radius")
        told(furcl(*command, "--default-radius", "0.25"), 0)
    assert (load_curves(folder / "b.npz").radii == 0.25).all()
    return "--default-radius is advised and mends it"


def _npz(**members: bytes | np.ndarray) -> bytes:
    """A zip file of arrays, or of bytes where arrays are expected."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in members.items():
            if not isinstance(content, bytes):
                member = io.BytesIO()
                np.save(member, content)
                content = member.getvalue()
            archive.writestr(f"{name}.npy", content)
    return file.getvalue()


def _header(text: str) -> bytes:
    """An array of any header."""
    line = text.encode("latin-1").ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(line)) + line + bytes(64)


def _shape(shape: str) -> bytes:
    return _header(f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}")


def _lzma() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("points.npy", bytes(1000))
    data = bytearray(file.getvalue())
    data[50:60] = b"\xff" * 10
    return bytes(data)


def _entry_name() -> bytes:
    """An entry whose name is said to be UTF-8 and is not."""
    data = bytearray(_npz(points=np.eye(3)))
    for sign, flags, name in ((b"PK\x03\x04", 6, 30), (b"PK\x01\x02", 8, 46)):
        at = data.index(sign)
        data[at + flags : at + flags + 2] = struct.pack("<H", 0x800)
        data[at + name] = 0xFF
    return bytes(data)


_POINTS, _COUNTS = np.eye(4)[:, :3], np.array([4])
_BAD: dict[str, tuple[Callable[[], bytes], str]] = {
    "npz: header of parentheses": (
        lambda: _npz(points=_header("(" * 100), radii=np.ones(1)),
        "cannot be read",
    ),
    "npz: damaged LZMA": (_lzma, "packed by method 14"),
    "npz: entry name that is not UTF-8": (_entry_name, "not a whole .npz"),
    "npz: scalar points with counts": (
        lambda: _npz(points=np.float32(1), radii=np.ones(1), counts=_COUNTS),
        "points has shape ()",
    ),
    "npz: shape (True, 3)": (lambda: _npz(points=_shape("(True, 3)")), "which is none"),
    "npz: shape of 10^400": (lambda: _npz(points=_shape("(" + "9" * 60 + ", 3)")), "claims"),
    "npz: deep header": (lambda: _npz(points=_header("[" * 90 + "]" * 20)), "cannot be read"),
    "npz: strands of 5 points and counts": (
        lambda: _npz(points=np.ones((2, 5, 3)), radii=np.ones(1), counts=np.array([5, 5])),
        "say themselves where strands begin",
    ),
    "hair: 2^32 - 1 strands": (
        lambda: (
            (b"HAIR" + struct.pack("<4I", 2**32 - 1, 4, 2, 3) + struct.pack("<f", 1.0)).ljust(
                128, b"\0"
            )
            + bytes(48)
        ),
        "do not add up",
    ),
}


def _bad(make: Callable[[], bytes], words: str, suffix: str, folder: Path, quick: bool) -> str:
    path = folder / f"a{suffix}"
    path.write_bytes(make())
    return refused(lambda: load_curves(path), GroomError, words)


def _equal_strands(folder: Path, quick: bool) -> str:
    """Points (S, K, 3) say where strands begin."""
    points = np.random.default_rng(1).random((3, 5, 3))
    np.savez(folder / "a.npz", points=points, radius=0.1)
    found = load_curves(folder / "a.npz")
    assert found.n_strands == 3
    assert np.array_equal(found.points, points.reshape(-1, 3).astype(np.float32))
    return "read as 3 strands of 5"


def _bomb(folder: Path, quick: bool) -> str:
    """An array that packs to a thousandth, in a process with little memory."""
    n = 2_000_000 if quick else 25_000_000
    np.savez_compressed(folder / "a.npz", points=np.zeros((n, 3), np.float32), radius=1.0)
    size = (folder / "a.npz").stat().st_size
    ended = furcl("info", folder / "a.npz")
    said = told(ended, 2, "offsets")
    assert ended.peak_bytes <= 4 * 12 * n + 80e6, f"{ended.peak_bytes / 1e6:.0f} MB"
    return (
        f"{size / 1e6:.1f} MB, decoded {12 * n / 1e6:.0f}: {ended.peak_bytes / 1e6:.0f} MB; {said}"
    )


def _name(name: Any, folder: Path, quick: bool) -> str:
    said = refused(lambda: load_curves(name), GroomError)
    refused(lambda: save_curves(_strands(1, 0.1), name), GroomError)
    return said


CASES = [
    Case("tips of radius 0", _tips),
    *(Case(f"every radius 0, {s}", partial(_all_zero, s)) for s in (".npz", ".hair")),
    *(
        Case(name, partial(_bad, make, words, f".{name.split(':')[0]}"))
        for name, (make, words) in _BAD.items()
    ),
    Case("npz: strands of equally many points", _equal_strands),
    Case("npz bomb", _bomb),
    Case("a groom's name with a zero", partial(_name, "a\0.npz")),
    Case("a groom's name of 5000 letters", partial(_name, "a" * 5000 + ".npz")),
    Case("a groom's name that cannot be encoded", partial(_name, "\ud800.npz")),
]
