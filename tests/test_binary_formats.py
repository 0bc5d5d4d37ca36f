"""Binary grooms that are read only: .tfx of TressFX, .data of USC-HairSalon, .npy."""

import io
import struct

import numpy as np
import pytest

from furcl.errors import GroomError
from furcl.groom.formats import load_curves

POINTS = np.arange(24, dtype="<f4").reshape(8, 3) ** 1.5
THICKNESS = np.array([0.5, 0.25], "<f4")
COLOURS = np.linspace(0, 1, 32, dtype="<f4").reshape(8, 4)


def tfx4(n=2, each=4, positions=160, thickness=True, colours=True):
    rows = np.column_stack([POINTS, [0, 1, 1, 1] * 2]).astype("<f4").tobytes()
    at_thickness = 160 + len(rows)
    offsets = [positions, 0, 0, at_thickness * thickness, (at_thickness + 8) * colours]
    head = struct.pack("<f2I5I", 4.0, n, each, *offsets) + bytes(128)
    return head + rows + THICKNESS.tobytes() + COLOURS.tobytes()


def tfx3(thickness=True, guides=0):
    rows = POINTS.tobytes()
    head = struct.pack("<f4I", 3.0, 2, 4, 3, 0) + bytes(124)
    head += struct.pack("<6I", 296, (296 + len(rows)) * thickness, 0, 0, guides, 0) + bytes(128)
    return head + rows + THICKNESS.tobytes()


TEXT = """version 2.0
scale 2.0
rotation 0 0 0
numStrands 2
strand 0 numVerts 4 texcoord 0.5 0.5
{}
strand 1 numVerts 4 texcoord 0.1 0.2
{}
""".format(*("\n".join(" ".join(map(repr, p)) for p in POINTS.tolist()[i : i + 4]) for i in (0, 4)))


def salon(n=2, counts=(4, 4)):
    data, at = struct.pack("<i", n), 0
    for count in counts:
        data += struct.pack("<i", count) + POINTS[at : at + count].tobytes()
        at += count
    return data


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def written(folder, data, suffix):
    path = folder / f"a{suffix}"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


GRID = POINTS.reshape(2, 4, 3)
GOOD = {
    "tfx 4": (tfx4(), ".tfx", True),
    "tfx 4, no thickness": (tfx4(thickness=False), ".tfx", False),
    "tfx 3": (tfx3(), ".tfx", True),
    "tfx 3, no thickness": (tfx3(thickness=False), ".tfx", False),
    "tfx 2": (TEXT.replace("scale 2.0", "scale 1.0"), ".tfx", False),
    "data": (salon(), ".data", False),
    "npy": (npy(GRID), ".npy", False),
    "npy of Fortran": (npy(np.asfortranarray(GRID.astype(np.float64))), ".npy", False),
    "npy with radii": (
        npy(np.dstack([GRID, np.broadcast_to(THICKNESS[:, None] / 2, (2, 4))])),
        ".npy",
        True,
    ),
}


@pytest.mark.parametrize("case", GOOD)
def test_strands(tmp_path, case):
    data, suffix, has_radii = GOOD[case]
    path = written(tmp_path, data, suffix)
    curves = load_curves(path, default_radius=0.125)
    np.testing.assert_array_equal(curves.points, POINTS)
    np.testing.assert_array_equal(curves.offsets, [0, 4, 8])
    radii = np.repeat(THICKNESS / 2, 4) if has_radii else np.full(8, 0.125)
    np.testing.assert_array_equal(curves.radii, radii)
    if not has_radii:
        with pytest.raises(GroomError, match="--default-radius R"):
            load_curves(path)


def test_what_else_they_hold(tmp_path):
    curves = load_curves(written(tmp_path, tfx4(), ".tfx"))
    np.testing.assert_array_equal(curves.colours, COLOURS[:, :3])
    assert load_curves(written(tmp_path, tfx3(guides=300), ".tfx")).ignored == ("guides",)
    curves = load_curves(written(tmp_path, TEXT, ".tfx"), 0.1)
    np.testing.assert_array_equal(curves.points, 2 * POINTS)
    curves = load_curves(written(tmp_path, salon(3, (4, 1, 3)), ".data"), 0.1)
    assert dict(curves.dropped) == {"single_points": 1}
    np.testing.assert_array_equal(curves.points, POINTS[[0, 1, 2, 3, 5, 6, 7]])
    flat = written(tmp_path, npy(POINTS), ".npy")
    assert load_curves(flat, 0.1, points_per_strand=4).n_strands == 2


BAD = {
    "tfx: another version": (struct.pack("<f", 5.0) + bytes(300), ".tfx", "no version 3.0 or 4.0"),
    "tfx: half a header": (tfx4()[:100], ".tfx", "ends at byte 100, inside the header of 160"),
    "tfx: cut off": (tfx4()[:200], ".tfx", "positions would reach from byte 160 to 288 of 200"),
    "tfx: 2^32 - 1 strands": (tfx4(n=2**32 - 1), ".tfx", "positions would reach from byte 160"),
    "tfx: no strands": (tfx4(n=0), ".tfx", "claims 0 strands of 4 points"),
    "tfx: positions at 0": (tfx4(positions=0), ".tfx", "positions would reach from byte 0"),
    "tfx: text cut off": (TEXT[:-20], ".tfx", "strand 1 has . points, its line says 4|holds"),
    "tfx: text of words": (TEXT.replace("0.0 1.0", "0.0 one"), ".tfx", "line 6: 'one' is no"),
    "tfx: a bad strand": (
        TEXT.replace("strand 1 numVerts", "strand 1"),
        ".tfx",
        "line 10: 'strand 1",
    ),
    "tfx: nothing": ("version 2.0\n", ".tfx", "the groom is empty"),
    "data: cut off": (salon()[:-1], ".data", "byte 56: strand 1 of 2 has 4 points"),
    "data: too long": (salon() + b"abcd", ".data", "4 bytes too many"),
    "data: negative": (salon(-1), ".data", "claims -1 strands"),
    "data: 2^31 strands": (salon(2**31 - 1), ".data", "claims 2147483647 strands"),
    "npy: cut off": (npy(GRID)[:-4], ".npy", "no whole .npy file"),
    "npy: text": ("x" * 200, ".npy", "no whole .npy file"),
    "npy: objects": (npy(np.array([{}], object)), ".npy", "no whole .npy file"),
    "npy: complex": (npy(GRID.astype(complex)), ".npy", "has type complex128"),
    "npy: of points": (npy(POINTS), ".npy", r"has shape \(8, 3\); .*--points-per-strand"),
    "npy: single points": (npy(GRID[:, :1]), ".npy", "2 strands of 1 points"),
    "npy: nan": (npy(np.where(GRID > 100, np.nan, GRID)), ".npy", "strand 1, point 3"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files(tmp_path, case):
    data, suffix, message = BAD[case]
    with pytest.raises(GroomError, match=message):
        load_curves(written(tmp_path, data, suffix), 0.1)
