"""OpenEXR files by this process and by another: the same pixels, and not a word of the library."""

from __future__ import annotations

import mmap
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from furcl.errors import ImageError
from furcl.image import exr_decode
from furcl.image.exr import read_exr
from furcl.image.exr_chunks import surely_whole
from furcl.image.exr_decode import decode, decode_apart
from furcl.image.exr_header import check_claims
from furcl.image.image import Image

COMPRESSIONS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
HERE = ("NO", "ZIPS", "ZIP")
SHAPE = (40, 23)


def written(path: Path, compression: str, dtype=np.float32, **header) -> Path:
    """A picture that packs, a part of it well."""
    steps = np.random.default_rng(3).integers(0, 9, (*SHAPE, 3))
    pixels = (steps / 8.0).astype(dtype)
    pixels[10:20] = 0.25
    kind = getattr(OpenEXR, f"{compression}_COMPRESSION")
    attributes = {"compression": kind, "type": OpenEXR.scanlineimage, **header}
    with OpenEXR.File(attributes, {"RGB": pixels}) as file:
        file.write(str(path))
    return path


def is_whole(path: Path) -> bool:
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return surely_whole(data, check_claims(path, data))


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_another_process_gives_the_same_bits(tmp_path, compression, dtype):
    path = written(tmp_path / "a.exr", compression, dtype)
    here = np.empty((3, *SHAPE), np.float32)
    decode(path, ["B", "G", "R"], here)
    np.testing.assert_array_equal(decode_apart(path, ["B", "G", "R"], SHAPE), here)
    channels, _ = read_exr(path)
    for name, plane in zip("BGR", here, strict=True):
        np.testing.assert_array_equal(channels[name], plane)
    assert is_whole(path) == (compression in HERE)


@pytest.mark.parametrize("compression", ["RLE", "ZIPS", "ZIP", "PXR24", "PIZ", "DWAA"])
def test_the_library_writes_nothing_here(tmp_path, compression, capfd):
    """Damage at 40 places of the pixels; what the library says of it, the error says."""
    path = written(tmp_path / "a.exr", compression)
    whole = path.read_bytes()
    refused = []
    for at in np.linspace(len(whole) // 2, len(whole) - 30, 40).astype(int):
        path.write_bytes(
            whole[:at] + bytes(b ^ 0x55 for b in whole[at : at + 20]) + whole[at + 20 :]
        )
        try:
            read_exr(path)
        except ImageError as error:
            refused.append(str(error))
    assert capfd.readouterr() == ("", "")
    # PIZ and RLE have no checksums: damage there may give other pixels.
    assert len(refused) == 40 or compression not in ("ZIPS", "ZIP", "PXR24")
    assert refused
    assert all(str(path) in error and "OpenEXR file: " in error for error in refused)


@pytest.mark.parametrize("compression", ["ZIPS", "ZIP"])
def test_a_changed_byte_of_packed_pixels_is_noticed(tmp_path, compression, capfd):
    """Or the library takes it too: bits between codes, and what Adler-32 does not tell apart."""
    path = written(tmp_path / "a.exr", compression)
    whole = path.read_bytes()
    assert is_whole(path)
    n_taken = 0
    with mmap.mmap(-1, len(whole)) as data:
        data[:] = whole
        begin = check_claims(path, data).end
    for at in range(begin, len(whole)):
        changed = bytearray(whole)
        changed[at] ^= 0x10
        with mmap.mmap(-1, len(whole)) as data:
            data[:] = bytes(changed)
            taken = surely_whole(data, check_claims(path, data))
        if taken:
            path.write_bytes(changed)
            decode(path, ["B", "G", "R"], np.empty((3, *SHAPE), np.float32))
            n_taken += 1
    assert n_taken < 0.02 * len(whole)  # measured 0.0104
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "header", [{"note": "\u00e9"}, {"weight": 0.5, "count": 3}, {"envmap": OpenEXR.ENVMAP_LATLONG}]
)
def test_headers_are_read_here(tmp_path, header):
    _, found = read_exr(written(tmp_path / "a.exr", "ZIP", **header))
    for name, value in header.items():
        assert found[name] == (value if name != "envmap" else "ENVMAP_LATLONG")


def test_subsampled_channels_are_refused(tmp_path):
    """All three are half as wide and high as the picture, so they agree with each other."""
    path = written(tmp_path / "a.exr", "NO")
    data = path.read_bytes()
    for name in (b"R\0", b"G\0", b"B\0"):
        at = data.index(name + (2).to_bytes(4, "little")) + 2 + 8
        data = data[:at] + (2).to_bytes(4, "little") * 2 + data[at + 8 :]
    path.write_bytes(data)
    with pytest.raises(ImageError, match="the channel 'B' is subsampled, 2 x 2"):
        Image.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"MEMORY_FACTOR": 0, "SLACK_BYTES": 0, "THREAD_BYTES": 0},
            "times the memory",
        ),
        ({"names": ["B", "G", "no such"]}, "no such"),
        ({"shape": (SHAPE[0], SHAPE[1] + 1)}, "broadcast"),
    ],
)
def test_what_the_other_process_cannot_do_is_an_error(tmp_path, monkeypatch, change, message):
    path = written(tmp_path / "a.exr", "PIZ")
    if "MEMORY_FACTOR" in change:
        monkeypatch.setattr(f"{__name__}.SHAPE", (512, 512))
        path = written(tmp_path / "a.exr", "PIZ")
        monkeypatch.setattr(exr_decode, "python_command", _changed(tmp_path, change))
    with pytest.raises(ValueError, match=message):
        decode_apart(path, change.get("names", ["B", "G", "R"]), change.get("shape", SHAPE))


def _changed(folder: Path, change: dict[str, int]):
    """What starts the other process with constants of its module replaced."""
    from furcl.paths import python_command

    script = folder / "start.py"
    lines = [
        f"{'exr_decode' if name == 'MEMORY_FACTOR' else 'memory'}.{name} = {value}"
        for name, value in change.items()
    ]
    script.write_text(
        "import sys\nfrom furcl import memory\nfrom furcl.image import exr_decode\n"
        + "\n".join(lines)
        + "\nsys.exit(exr_decode.main(sys.argv[1]))\n"
    )
    return lambda *arguments: python_command(str(script), arguments[-1])


def test_no_process_can_be_started(tmp_path, monkeypatch):
    path = written(tmp_path / "a.exr", "PIZ")
    monkeypatch.setattr(exr_decode, "python_command", lambda *a: ["/no/such/python"])
    with pytest.raises(ImageError, match="no process can decode it: No such file"):
        Image.load(path)
