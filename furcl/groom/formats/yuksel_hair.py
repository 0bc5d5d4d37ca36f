"""Cem Yuksel's .hair files (cemyuksel.com/research/hairmodels), little endian.

A header of 128 bytes, then the arrays that its flags announce: segments per strand (u16), points
(3 f32), thickness (f32, a diameter), transparency (f32), colours (3 f32). An array that is absent
has one value for all strands in the header.
"""

import logging
from pathlib import Path
from typing import BinaryIO

import numpy as np

from furcl.errors import GroomError
from furcl.groom.curves import ADVICE, Curves
from furcl.groom.formats.format import Asked, Format, Strands
from furcl.memory import require_memory

log = logging.getLogger(__name__)

HEADER = np.dtype(
    [
        ("magic", "S4"),
        ("n_strands", "<u4"),
        ("n_points", "<u4"),
        ("arrays", "<u4"),
        ("default_segments", "<u4"),
        ("default_thickness", "<f4"),
        ("default_transparency", "<f4"),
        ("default_colour", "<f4", (3,)),
        ("info", "S88"),
    ]
)
HAS_SEGMENTS, HAS_POINTS, HAS_THICKNESS, HAS_TRANSPARENCY, HAS_COLOURS = 1, 2, 4, 8, 16
ALL_ARRAYS = 31
MAX_SEGMENTS = 65535


def read_hair(path: Path, asked: Asked) -> Strands:
    """Read a .hair file.

    The size that the header announces is compared with the file's before anything is allocated.
    Colours are kept when there is an array of them; transparency has no place in a groom and is
    counted in `Curves.dropped`.

    Parameters
    ----------
    path : Path                  the file
    asked : Asked                its default_radius is used where the file holds no thickness but 0

    Raises
    ------
    GroomError                   the file's name, the byte offset or strand, and a remedy
    """
    default_radius = asked.default_radius
    with path.open("rb") as file:
        header = _read_header(file, path)
        sizes = _array_sizes(header)
        _check_size(header, sizes, path)
        n_points = int(header["n_points"])
        offsets = _read_offsets(file, header, path)
        points = _read(file, "<f4", 3 * n_points, path).reshape(n_points, 3)
        if sizes["thickness"]:
            radii = _read(file, "<f4", n_points, path)
            with np.errstate(invalid="ignore", under="ignore"):  # NaN is refused below
                radii *= 0.5
            if default_radius is not None and not radii.any():
                radii = np.float32(default_radius)
        else:
            radii = np.float32(_default_radius(header, default_radius, path))
        file.seek(sizes["transparency"], 1)
        colours = None
        if sizes["colours"]:
            colours = _read(file, "<f4", 3 * n_points, path).reshape(n_points, 3)
    dropped = {"transparency_values": n_points if sizes["transparency"] else 0}
    named = {} if colours is None else {"colours": colours}
    return Strands(points, radii, offsets, str(path), named, dropped)


def write_hair(curves: Curves, file: BinaryIO, path: Path) -> None:
    """Write a .hair file to an open binary file; `path` is named in messages.

    Counts and thicknesses that are the same everywhere go to the header's defaults. Colours of
    strands become those of their points; of other attributes the log says that they are left out.

    Raises
    ------
    GroomError                   a strand of more than 65535 segments
    """
    segments = np.diff(curves.offsets) - 1
    longest = int(np.argmax(segments))
    if segments[longest] > MAX_SEGMENTS:
        raise GroomError(
            f"{path}: strand {longest} has {segments[longest]} segments; .hair stores at most "
            f"{MAX_SEGMENTS} a strand. Write .npz instead, or split or simplify the strand."
        )
    header = np.zeros((), dtype=HEADER)
    header["magic"] = b"HAIR"
    header["info"] = b"furcl"
    header["n_strands"], header["n_points"] = curves.n_strands, curves.n_points
    header["default_colour"] = 1.0
    header["default_segments"] = segments[0]
    header["default_thickness"] = 2.0 * curves.radii[0]
    uneven = bool((segments != segments[0]).any())
    tapered = bool((curves.radii != curves.radii[0]).any())
    coloured = curves.colours is not None
    header["arrays"] = (
        HAS_POINTS | HAS_SEGMENTS * uneven | HAS_THICKNESS * tapered | HAS_COLOURS * coloured
    )
    file.write(header.tobytes())
    if uneven:
        segments.astype("<u2").tofile(file)
    curves.points.astype("<f4", copy=False).tofile(file)
    if tapered:
        (curves.radii * np.float32(2.0)).astype("<f4", copy=False).tofile(file)
    if curves.colours is not None:
        colours = curves.colours
        if len(colours) == curves.n_strands:
            colours = np.repeat(colours, np.diff(curves.offsets), axis=0)
        colours.astype("<f4", copy=False).tofile(file)
    others = [name for name in curves.attributes if name != "colours"]
    others += ["time steps after the first"] if curves.times else []
    if others:
        log.warning("%s: .hair has no place for %s; write .npz to keep it", path, ", ".join(others))


def _read_header(file, path):
    data = file.read(HEADER.itemsize)
    if data[:4] != b"HAIR":
        raise GroomError(
            f"{path}: byte 0 holds {data[:4]!r}; a .hair file begins with b'HAIR'. Is it another "
            "format, or compressed?"
        )
    if len(data) < HEADER.itemsize:
        raise GroomError(
            f"{path}: the file ends at byte {len(data)}, inside the header of {HEADER.itemsize} "
            "bytes; it is truncated, fetch or export it again."
        )
    header = np.frombuffer(data, dtype=HEADER)[0]
    arrays = int(header["arrays"])
    if arrays & ~ALL_ARRAYS:
        raise GroomError(
            f"{path}: the array flags at byte 12 are {arrays:#x}; only the bits of {ALL_ARRAYS:#x} "
            "are known. The header is damaged or of another format."
        )
    if not arrays & HAS_POINTS:
        raise GroomError(
            f"{path}: the array flags at byte 12 are {arrays:#x}, without points (bit 1); a groom "
            "needs them, export it with points."
        )
    return header


def _array_sizes(header):
    """Bytes of each array of the file, in order; 0 where it is absent."""
    flags, n_points = int(header["arrays"]), int(header["n_points"])
    return {
        "segments": 2 * int(header["n_strands"]) if flags & HAS_SEGMENTS else 0,
        "points": 12 * n_points,
        "thickness": 4 * n_points if flags & HAS_THICKNESS else 0,
        "transparency": 4 * n_points if flags & HAS_TRANSPARENCY else 0,
        "colours": 12 * n_points if flags & HAS_COLOURS else 0,
    }


def _check_size(header, sizes, path):
    n_strands, n_points = int(header["n_strands"]), int(header["n_points"])
    claim = f"the header claims {n_strands} strands and {n_points} points"
    if n_strands == 0 or n_points == 0:
        raise GroomError(
            f"{path}: the groom is empty: {claim}; at least one strand of two points is needed."
        )
    found, end = path.stat().st_size, HEADER.itemsize
    for name, size in sizes.items():
        if end + size > found:
            raise GroomError(
                f"{path}: truncated at byte {found}: {claim}, whose {name} would reach from byte "
                f"{end} to {end + size}. Fetch or export the file again."
            )
        end += size
    if end != found:
        raise GroomError(
            f"{path}: {found - end} bytes too many: {claim}, which end at byte {end} of {found}. "
            "The header does not belong to the data; export the file again."
        )
    require_memory(path, n_bytes=4 * end, error=GroomError)


def _read_offsets(file, header, path):
    n_strands, n_points = int(header["n_strands"]), int(header["n_points"])
    offsets = None
    if int(header["arrays"]) & HAS_SEGMENTS:
        offsets = np.zeros(n_strands + 1, dtype=np.int64)
        np.cumsum(_read(file, "<u2", n_strands, path).astype(np.int64) + 1, out=offsets[1:])
        total, rule = int(offsets[-1]), "the segments from byte 128 on, plus one a strand,"
    else:
        segments = int(header["default_segments"])
        total, rule = n_strands * (segments + 1), f"{n_strands} strands of {segments} segments"
        if total == n_points:
            offsets = np.arange(n_strands + 1, dtype=np.int64) * (segments + 1)
    if total != n_points:
        raise GroomError(
            f"{path}: the counts do not add up: {rule} make {total} points, the header says "
            f"{n_points} at byte 8. Export the file again."
        )
    return offsets


def _read(file, dtype, count, path):
    array = np.fromfile(file, dtype=dtype, count=count)
    if len(array) != count:
        raise GroomError(
            f"{path}: the file ended at byte {file.tell()} while it was read; is another program "
            "writing it?"
        )
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def _default_radius(header, default_radius, path):
    thickness = float(header["default_thickness"])
    if thickness > 0.0:  # an infinite one is refused with the other radii
        return 0.5 * thickness
    if default_radius is None:
        raise GroomError(
            f"{path}: no thickness array, and the default thickness at byte 20 is {thickness:g}; "
            f"a positive one is needed. {ADVICE}"
        )
    return default_radius


FORMAT = Format(
    name="Yuksel's .hair",
    suffixes=(".hair",),
    read=read_hair,
    write=write_hair,
    about="Cem Yuksel's binary files (cemyuksel.com/research/hairmodels), little endian, which "
    "many programs of research read and write.",
    points="the points of a strand, joined by straight segments, at most 65,536",
    radius="half of the thickness of a point, or of the header's default",
    kept="colours of points",
    left_out="transparency is counted and left out; other attributes are not written. Sizes that "
    "do not add up to the file's are refused.",
)
