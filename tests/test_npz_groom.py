"""The .npz grooms: accepted variants, and bad files with the message of each."""

import io
import zipfile

import numpy as np
import pytest
from groom_files import POINTS, THICKNESS, assert_same, good_arrays, npz_bytes, written

from furcl.errors import GroomError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves


def forged_npz(n_rows, n_bytes=240):
    """An .npz whose points claim n_rows rows but hold n_bytes bytes."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": (n_rows, 3)}
    )
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("points.npy", header.getvalue() + bytes(n_bytes))
    return file.getvalue()


BAD_NPZ = {
    "empty file": (b"", "it is empty"),
    "not a zip": (b"points " * 40, "not a whole .npz"),
    "truncated": (npz_bytes(**good_arrays())[:-30], "not a whole .npz"),
    "no points": (npz_bytes(radii=THICKNESS), "no array 'points'; expected points"),
    "no radii": (npz_bytes(**good_arrays(radii=None)), "no array 'radii'.*default_radius"),
    "no strands": (npz_bytes(**good_arrays(offsets=None)), "neither 'offsets' nor 'counts'"),
    "pickled": (npz_bytes(points=np.array([{}])), "'points' cannot be read: .*never loaded"),
    "2^31 points": (forged_npz(2**31), r"shape \(2147483648, 3\) .* claims 2576980\d+ bytes; 368"),
    "wrong shape": (npz_bytes(**good_arrays(points=POINTS.ravel())), "expected .N, 3."),
    "offsets past the end": (
        npz_bytes(**good_arrays(offsets=np.array([0, 3, 10]))),
        "run from 0 to 10; they must run from 0 to the number of points, 9",
    ),
    "counts too few": (
        npz_bytes(**good_arrays(offsets=None, counts=np.array([3, 2]))),
        "counts do not add up: they make 5 points, 'points' has 9",
    ),
    "negative count": (
        npz_bytes(**good_arrays(offsets=None, counts=np.array([11, -2]))),
        "counts run from -2 to 11",
    ),
    "real counts": (
        npz_bytes(**good_arrays(offsets=None, counts=np.array([9.0]))),
        "counts has .* float64; expected a flat array of integers",
    ),
    "disagreement": (
        npz_bytes(**good_arrays(counts=np.array([3, 3, 3]))),
        "'offsets' and 'counts' disagree",
    ),
    "zero radius": (npz_bytes(**good_arrays(radii=np.float32(0))), "point 0: radius 0"),
    "nan": (npz_bytes(**good_arrays(points=POINTS * np.nan)), "strand 0, point 0 is .nan"),
}


@pytest.mark.parametrize("case", BAD_NPZ)
def test_bad_npz(tmp_path, case):
    data, message = BAD_NPZ[case]
    path = written(tmp_path, data, "groom.npz")
    with pytest.raises(GroomError, match=message) as caught:
        load_curves(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_damaged_npz_data_is_refused(tmp_path):
    data = bytearray(npz_bytes(**good_arrays()))
    data[200] ^= 0xFF  # inside the points: the checksum of the member no longer fits
    with pytest.raises(GroomError, match="CRC"):
        load_curves(written(tmp_path, bytes(data), "groom.npz"))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"offsets": np.array([0, 3, 5, 9], np.uint32)},
        {"offsets": None, "counts": np.array([3, 2, 4], np.uint8)},
        {"counts": np.array([3, 2, 4])},
        {"points": POINTS.astype(np.float64)},
        {"points": np.asfortranarray(POINTS)},
        {"points": POINTS.astype(">f4")},
        {"scene": np.array("{}")},
    ],
    ids=str,
)
def test_npz_variants(tmp_path, changes):
    curves = load_curves(written(tmp_path, npz_bytes(**good_arrays(**changes)), "groom.npz"))
    assert_same(curves, Curves.from_arrays(POINTS, THICKNESS / 2, [0, 3, 5, 9]))


@pytest.mark.parametrize("name", ["radii", "radius"])
def test_npz_scalar_radius(tmp_path, name):
    arrays = {**good_arrays(radii=None), name: 0.125}
    curves = load_curves(written(tmp_path, npz_bytes(**arrays), "groom.npz"))
    np.testing.assert_array_equal(curves.radii, np.full(9, 0.125, np.float32))
