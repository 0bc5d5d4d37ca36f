"""The text files of Mitsuba 3's curve shapes: a point a line, an empty line between strands."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import BinaryIO

import numpy as np

from furcl.errors import GroomError
from furcl.files import open_regular
from furcl.groom.curves import ADVICE, Curves
from furcl.groom.formats.format import Asked, Format, Strands
from furcl.groom.formats.text_rows import number_rows

log = logging.getLogger(__name__)

POINTS_AT_ONCE = 1 << 15


def read_mitsuba(path: Path, asked: Asked) -> Strands:
    """Read lines `x y z radius`, or `x y z` of files without radii.

    Block by block: beside the arrays of the groom little memory is taken.

    Raises
    ------
    GroomError          the line, and what it holds
    """
    expected = "a line holds x y z radius, or x y z, and an empty one begins another strand"
    points, breaks, n_points, width = [], [], 0, 0
    with open_regular(path) as file:
        for rows in number_rows(file, path, expected):
            full = rows.counts > 0
            if not width and full.any():
                width = int(rows.counts[np.argmax(full)])
            bad = full & ((rows.counts != width) | ((width != 3) & (width != 4)))
            if bad.any():
                at = int(np.argmax(bad))
                alike = f", and lines before hold {width}" if width in (3, 4) else ""
                raise GroomError(
                    f"{path}: line {rows.line + at} holds {rows.counts[at]} numbers{alike}; "
                    f"{expected}. Repair the file."
                )
            breaks.append(n_points + np.cumsum(full)[~full])
            n_points += int(np.count_nonzero(full))
            with np.errstate(over="ignore", under="ignore"):
                points.append(rows.values.astype(np.float32).reshape(-1, width or 1))
    if not n_points:
        raise GroomError(f"{path}: the groom is empty: no line holds a point. Export it again.")
    offsets = np.unique(np.concatenate([[0], *breaks, [n_points]])).astype(np.int64)
    values = np.concatenate([block for block in points if len(block)])
    radii = values[:, 3].copy() if width == 4 else np.zeros(1, np.float32)
    if not radii.any():
        if asked.default_radius is None:
            missing = "its radii are all 0" if width == 4 else "its lines hold x y z and no radius"
            raise GroomError(f"{path}: {missing}. {ADVICE}")
        radii = np.float32(asked.default_radius)
    return Strands(np.ascontiguousarray(values[:, :3]), radii, offsets, str(path))


def write_mitsuba(curves: Curves, file: BinaryIO, path: Path) -> None:
    """Write lines `x y z radius` with as many digits as keep every bit."""
    begins = np.zeros(curves.n_points, bool)
    begins[curves.offsets[1:-1]] = True
    for first in range(0, curves.n_points, POINTS_AT_ONCE):
        part = slice(first, first + POINTS_AT_ONCE)
        rows = np.column_stack([curves.points[part], curves.radii[part]]).tolist()
        file.write(
            b"".join(
                b"%s%.9g %.9g %.9g %.9g\n" % (b"\n" if begin else b"", *row)
                for begin, row in zip(begins[part].tolist(), rows, strict=True)
            )
        )
    if curves.attributes:
        names = ", ".join(curves.attributes)
        log.warning("%s: Mitsuba's text has no place for %s; write .npz to keep it", path, names)


FORMAT = Format(
    name="Mitsuba 3 text curves",
    suffixes=(".txt",),
    read=read_mitsuba,
    write=write_mitsuba,
    about="The files of Mitsuba 3's shapes `linearcurve` and `bsplinecurve`; those of the `hair` "
    "shape of Mitsuba 0.6 without radii are read too.",
    points="lines `x y z radius`, an empty line between strands. The file does not say which of "
    "the "
    'two shapes it is of: corners of polylines, or with `basis = "bspline"` (`--basis bspline`) '
    "control points. Written as polylines.",
    radius="the fourth number of a line",
    left_out="lines of other than 3 or 4 numbers, and anything but numbers, are refused. The "
    "shape's `to_world` is in Mitsuba's scene: give the groom a transform.",
)
