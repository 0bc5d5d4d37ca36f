"""The .hair format: every combination of arrays, and bad files with the message of each."""

import itertools

import numpy as np
import pytest
from groom_files import COLOURS, COUNTS, POINTS, THICKNESS, assert_same, hair_bytes, written

from furcl.errors import GroomError
from furcl.groom.curves import Curves
from furcl.groom.formats import load_curves, save_curves


@pytest.mark.parametrize("optional", list(itertools.product([0, 1], repeat=4)))
def test_hair_flags(tmp_path, optional):
    has_segments, has_thickness, has_transparency, has_colours = optional
    flags = 2 | has_segments | has_thickness << 2 | has_transparency << 3 | has_colours << 4
    curves = load_curves(written(tmp_path, hair_bytes(flags=flags)))
    np.testing.assert_array_equal(curves.points, POINTS)
    np.testing.assert_array_equal(np.diff(curves.offsets), COUNTS if has_segments else (3, 3, 3))
    np.testing.assert_array_equal(
        curves.radii, THICKNESS / 2 if has_thickness else np.full(9, 0.25)
    )
    assert dict(curves.dropped) == ({"transparency_values": 9} if has_transparency else {})
    if has_colours:
        np.testing.assert_array_equal(curves.colours, COLOURS)
    else:
        assert curves.colours is None


BAD_HAIR = {
    "empty file": (b"", "it is empty"),
    "wrong magic": (hair_bytes(magic=b"RIAH"), "byte 0 holds b'RIAH'"),
    "half a header": (hair_bytes()[:100], "ends at byte 100, inside the header of 128"),
    "no points array": (hair_bytes(flags=5), "flags at byte 12 are 0x5, without points"),
    "unknown flag": (hair_bytes(flags=39), "flags at byte 12 are 0x27; only the bits of 0x1f"),
    "no strands": (hair_bytes(n_strands=0), "empty: the header claims 0 strands"),
    "no points": (hair_bytes(n_points=0), "empty: the header claims 3 strands and 0 points"),
    "2^31 points in 200 bytes": (
        hair_bytes(n_points=2**31)[:200],
        "truncated at byte 200: .* 2147483648 points, whose points would reach from byte 134 to",
    ),
    "2^31 strands in 200 bytes": (
        hair_bytes(n_strands=2**31)[:200],
        "truncated at byte 200: .* whose segments would reach",
    ),
    "2^32-1 of both, no segments array": (
        hair_bytes(flags=2, n_strands=2**32 - 1, n_points=2**32 - 1)[:200],
        "truncated at byte 200",
    ),
    "truncated points": (hair_bytes()[:150], "truncated at byte 150: .* points would reach"),
    "truncated thickness": (hair_bytes()[:-1], "thickness would reach from byte 242 to 278"),
    "trailing bytes": (hair_bytes() + b"xy", "2 bytes too many.* end at byte 278 of 280"),
    "sum of segments": (
        hair_bytes(segments=(2, 1, 4)),
        "the segments from byte 128 on, .* make 10 points, the header says 9 at byte 8",
    ),
    "default segments": (
        hair_bytes(flags=6, default_segments=3),
        "3 strands of 3 segments make 12 points, the header says 9",
    ),
    "default segments of 2^32-1": (
        hair_bytes(flags=6, default_segments=2**32 - 1),
        "3 strands of 4294967295 segments make 12884901888 points",
    ),
    "no thickness": (hair_bytes(flags=3, default_thickness=0), "byte 20 is 0; .*default_radius"),
    "bad default": (hair_bytes(flags=3, default_thickness=-1), "byte 20 is -1; .*default_radius"),
    "nan default": (hair_bytes(flags=3, default_thickness=np.nan), "byte 20 is nan"),
    "infinite default": (hair_bytes(flags=3, default_thickness=np.inf), "point 0: radius inf"),
    "strand of one point": (hair_bytes(segments=(2, 0, 4)), "strand 1 has 1 point; .*at least 2"),
    "nan point": (
        hair_bytes(points=np.where(np.arange(27).reshape(9, 3) == 13, np.nan, POINTS)),
        r"strand 1, point 1 is \(.*, nan, .*finite",
    ),
    "zero thickness": (hair_bytes(thickness=THICKNESS * 0), "strand 0, point 0: radius 0"),
    "negative thickness": (hair_bytes(thickness=-THICKNESS), "strand 0, point 0: radius -0.1"),
    "one place only": (hair_bytes(points=np.ones((9, 3))), "empty: all points"),
}


@pytest.mark.parametrize("case", BAD_HAIR)
def test_bad_hair(tmp_path, case):
    data, message = BAD_HAIR[case]
    path = written(tmp_path, data)
    with pytest.raises(GroomError, match=message) as caught:
        load_curves(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_every_truncation_of_a_hair_file_is_refused(tmp_path):
    data = hair_bytes(flags=31)
    for size in range(len(data)):
        with pytest.raises(GroomError):
            load_curves(written(tmp_path, data[:size]))


def test_long_strand_is_refused_by_hair_and_leaves_the_old_file(tmp_path):
    points = np.zeros((65539, 3), np.float32)
    points[:, 0] = np.arange(65539)
    curves = Curves.from_arrays(points, 0.1, [0, 2, 65539])
    path = tmp_path / "long.hair"
    path.write_bytes(b"old")
    with pytest.raises(GroomError, match=r"long\.hair: strand 1 has 65536 segments; .*65535"):
        save_curves(curves, path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["long.hair"]
    longest_allowed = Curves.from_arrays(points[:65536], 0.1, [0, 65536])
    save_curves(longest_allowed, path)
    assert_same(load_curves(path), longest_allowed)
