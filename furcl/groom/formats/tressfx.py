"""AMD TressFX's .tfx: versions 3 and 4 in binary, 1 and 2 as text."""

from __future__ import annotations

import re
import struct
from array import array
from pathlib import Path

import numpy as np

from furcl.errors import GroomError
from furcl.groom.curves import ADVICE
from furcl.groom.formats.format import Asked, Format, Strands, mapped
from furcl.memory import require_memory
from furcl.values import shown

VERSIONS = (3.0, 4.0)
#: Names of the offsets in the header, from its byte OFFSETS_AT on; 0 is of an array that is absent.
OFFSETS = {
    3.0: ("positions", "thickness", "strand_uv", "colours", "guides", "point_uv"),
    4.0: ("positions", "strand_uv", "point_uv", "thickness", "colours"),
}
OFFSETS_AT = {3.0: 144, 4.0: 12}
HEADER_BYTES = {3.0: 296, 4.0: 160}
POSITION_FLOATS = {3.0: 3, 4.0: 4}
TEXT_HEADER_BYTES = 1 << 14
_STRAND = re.compile(rb"^\s*strand\s+\d+\s+numVerts\s+(\d+)\b", re.MULTILINE)


def read_tfx(path: Path, asked: Asked) -> Strands:
    """Read guide strands; what a header claims is compared with the file before it is read.

    Raises
    ------
    GroomError      the byte offset, line or strand, and a remedy
    """
    with path.open("rb") as file:
        head = file.read(4)
    version = round(struct.unpack("<f", head)[0], 3) if len(head) == 4 else 0.0
    if version in VERSIONS:
        return _binary(path, asked, version)
    with path.open("rb") as file:
        text = file.read(TEXT_HEADER_BYTES)
    if text.lstrip()[:7] == b"version" or _STRAND.search(text):
        return _text(path, asked)
    raise GroomError(
        f"{path}: byte 0 holds {head!r}, which is no version 3.0 or 4.0, nor a text of version 1 "
        "or 2; is it a .tfx of TressFX?"
    )


def _binary(path: Path, asked: Asked, version: float) -> Strands:
    data = mapped(path)
    if len(data) < HEADER_BYTES[version]:
        raise GroomError(
            f"{path}: the file ends at byte {len(data)}, inside the header of "
            f"{HEADER_BYTES[version]} bytes; it is cut off, fetch it again."
        )
    n_strands, each = (int(n) for n in np.frombuffer(data, "<u4", 2, 4))
    at = dict(
        zip(
            OFFSETS[version],
            (
                int(n)
                for n in np.frombuffer(data, "<u4", len(OFFSETS[version]), OFFSETS_AT[version])
            ),
            strict=True,
        )
    )
    n_points = n_strands * each
    if not n_points:
        raise GroomError(
            f"{path}: the groom is empty: the header claims {n_strands} strands of {each} points."
        )
    require_memory(path, n_bytes=4 * len(data), error=GroomError)
    width = POSITION_FLOATS[version]
    rows = _array(data, at["positions"], (n_points, width), "positions", path)
    points = np.ascontiguousarray(rows[:, :3], np.float32)
    attributes = {}
    if at["colours"]:
        colours = _array(data, at["colours"], (n_points, 4), "colours", path)
        attributes["colours"] = np.ascontiguousarray(colours[:, :3], np.float32)
    radii = None
    if at["thickness"]:
        with np.errstate(invalid="ignore", over="ignore", under="ignore"):
            thickness = _array(data, at["thickness"], (n_strands,), "thickness", path)
            radii = np.repeat(thickness.astype(np.float32) * np.float32(0.5), each)
    if radii is None or not radii.any():
        if asked.default_radius is None:
            raise GroomError(f"{path}: the file has no thickness of strands. {ADVICE}")
        radii = np.float32(asked.default_radius)
    offsets = np.arange(n_strands + 1, dtype=np.int64) * each
    left = [name for name in ("strand_uv", "point_uv", "guides") if at.get(name)]
    return Strands(points, radii, offsets, str(path), attributes, ignored=left)


def _array(data, offset, shape, name, path):
    n_bytes = 4 * int(np.prod([int(n) for n in shape], dtype=object))
    if offset < 4 or offset + n_bytes > len(data):
        raise GroomError(
            f"{path}: the {name} would reach from byte {offset} to {offset + n_bytes} of "
            f"{len(data)}; the file is cut off or its header damaged, fetch it again."
        )
    return np.frombuffer(data, "<f4", n_bytes // 4, offset).reshape(shape)


def _text(path: Path, asked: Asked) -> Strands:
    """Lines `strand i numVerts k texcoord u v`, and k lines `x y z` after each."""
    counts, scale, line = [], 1.0, 0
    values, expected = array("f"), 0
    what = "a line holds x y z of a point, or begins with 'strand'"
    with path.open("rb") as file:
        while text := file.readline(TEXT_HEADER_BYTES):
            line += 1
            words = text.split()
            if words[:1] == [b"strand"]:
                _check_count(counts, expected, path, line)
                expected = _points_of_strand(text, path, line)
                counts.append(0)
            elif counts and words:
                if len(words) != 3:
                    raise GroomError(
                        f"{path}: line {line} holds {len(words)} words; {what}. Repair the file."
                    )
                values.extend(_number(word, path, line) for word in words)
                counts[-1] += 1
            elif words[:1] == [b"scale"] and len(words) > 1:
                scale = _number(words[1], path, line)
    _check_count(counts, expected, path, line)
    if not values:
        raise GroomError(f"{path}: the groom is empty: no strand has points.")
    if asked.default_radius is None:
        raise GroomError(f"{path}: files of versions 1 and 2 have no radii. {ADVICE}")
    with np.errstate(over="ignore", under="ignore"):
        points = np.frombuffer(values, np.float32).reshape(-1, 3) * np.float32(scale)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Strands(points, np.float32(asked.default_radius), offsets, str(path))


def _points_of_strand(text, path, line):
    found = _STRAND.match(text)
    if found is None or len(found[1]) > 9:
        raise GroomError(
            f"{path}: line {line}: {shown(text.decode('latin-1').strip())}; a strand begins with "
            "'strand NUMBER numVerts COUNT'. Repair the file."
        )
    return int(found[1])


def _check_count(counts, expected, path, line):
    """Refuse a strand that has other than the points that its line says."""
    if counts and counts[-1] != expected:
        raise GroomError(
            f"{path}: before line {line}: strand {len(counts) - 1} has {counts[-1]} points, its "
            f"line says {expected}; repair the file."
        )


def _number(word, path, line):
    """A number within float32; one beyond is infinite, and refused with its point."""
    try:
        value = float(word)
    except ValueError:
        found = shown(word.decode("latin-1"))
        raise GroomError(f"{path}: line {line}: {found} is no number. Repair the file.") from None
    return value if abs(value) < 3e38 else float("inf")


FORMAT = Format(
    name="TressFX",
    suffixes=(".tfx",),
    read=read_tfx,
    write=None,
    about="AMD's TressFX: binary files of versions 3 and 4, text of versions 1 and 2.",
    points="the guide strands, with as many points each as the header says. Followers are not in "
    "the "
    'file: `generator = "interpolate"` of a scene makes children.',
    radius="half of a strand's thickness, of versions 3 and 4 that have it; none in text",
    units="says none; y is up in TressFX's own samples (`--up y`). `scale` of the text is applied.",
    kept="colours of points (versions 3 and 4)",
    left_out="texture coordinates and the list of guides; rotation and translation of the text",
)
