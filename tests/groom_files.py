"""Groom files made by hand for the tests, without the writers that they test."""

import io
import struct

import numpy as np

COUNTS = (3, 2, 4)
POINTS = np.arange(27, dtype="<f4").reshape(9, 3) ** 1.5
THICKNESS = np.linspace(0.2, 1.0, 9, dtype="<f4")
COLOURS = np.linspace(0.0, 1.0, 27, dtype="<f4").reshape(9, 3)


def hair_bytes(
    flags=7,
    n_strands=3,
    n_points=9,
    segments=(2, 1, 3),
    default_segments=2,
    default_thickness=0.5,
    points=POINTS,
    thickness=THICKNESS,
    magic=b"HAIR",
):
    """A .hair file put together by hand from its description."""
    header = magic + struct.pack("<4I", n_strands, n_points, flags, default_segments)
    header += struct.pack("<5f", default_thickness, 0.25, 0.1, 0.2, 0.3) + b"made by hand"
    arrays = [
        np.asarray(segments, "<u2"),
        np.asarray(points, "<f4"),
        np.asarray(thickness, "<f4"),
        np.full(9, 0.5, "<f4"),
        COLOURS,
    ]
    present = [a.tobytes() for bit, a in enumerate(arrays) if flags >> bit & 1]
    return header.ljust(128, b"\0") + b"".join(present)


def npz_bytes(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def good_arrays(**changes):
    arrays = {"points": POINTS, "radii": THICKNESS / 2, "offsets": np.array([0, 3, 5, 9])}
    return {k: v for k, v in {**arrays, **changes}.items() if v is not None}


def assert_same(found, expected):
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.radii, expected.radii)
    np.testing.assert_array_equal(found.offsets, expected.offsets)
    if expected.colours is None:
        assert found.colours is None
    else:
        np.testing.assert_array_equal(found.colours, expected.colours)


def written(folder, data, name="groom.hair"):
    """Write bytes to a file in a folder and return its path."""
    path = folder / name
    path.write_bytes(data)
    return path
