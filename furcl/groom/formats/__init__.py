"""Reading and writing grooms; one file a format, found by FORMATS."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from furcl.errors import GroomError
from furcl.files import atomic_path, check_regular, named
from furcl.groom.curves import Curves, adopted
from furcl.groom.flatten import flattened
from furcl.groom.formats.format import BASES, Asked, Format, Strands
from furcl.groom.formats.hair_salon import FORMAT as HAIR_SALON
from furcl.groom.formats.mitsuba_text import FORMAT as MITSUBA_TEXT
from furcl.groom.formats.npy import FORMAT as NPY
from furcl.groom.formats.npz import FORMAT as NPZ
from furcl.groom.formats.pbrt import FORMAT as PBRT
from furcl.groom.formats.ply import FORMAT as PLY
from furcl.groom.formats.tressfx import FORMAT as TRESSFX
from furcl.groom.formats.usd import FORMAT as USD
from furcl.groom.formats.yuksel_hair import FORMAT as YUKSEL_HAIR
from furcl.groom.motion import time_steps
from furcl.values import is_number, is_whole, shown

Reader = Callable[[Path, float | None], Curves]
Writer = Callable[[Curves, BinaryIO, Path], None]

#: furcl's own.
FORMATS: tuple[Format, ...] = (
    YUKSEL_HAIR,
    NPZ,
    PLY,
    USD,
    MITSUBA_TEXT,
    TRESSFX,
    NPY,
    HAIR_SALON,
    PBRT,
)
#: Suffixes of what is known and not read, and what to do.
NOT_READ = {
    ".abc": "no small library reads Alembic. Convert it: in Blender, import it and export USD "
    "(File > Export > Universal Scene Description, with hair); in Houdini, write .usd by a USD ROP",
    ".blend": "Blender reads its own files only: export USD with hair from it",
    ".xgen": "export the curves from Maya as USD",
    ".bgeo": "write .usd by a USD ROP of Houdini",
    ".gltf": "glTF has no strands: export USD",
    ".glb": "glTF has no strands: export USD",
    ".obj": "OBJ has no radii or strands that are told apart: export USD or PLY",
    ".fbx": "FBX has no strands: export USD",
}
_BUILT_IN = {suffix: form for form in FORMATS for suffix in form.suffixes}
_known: dict[str, Format] = dict(_BUILT_IN)


def suffixes(*, written: bool = False) -> tuple[str, ...]:
    """Suffixes of the formats that are read, or those that are written too; furcl's own first."""
    return tuple(s for s, form in _known.items() if form.write or not written)


def register(suffix: str, read: Reader, write: Writer | None = None) -> None:
    """Read, and write, grooms of a format of one's own by its suffix, which is replaced if there.

    Parameters
    ----------
    suffix : str        with its dot, in lower case
    read : callable     given the path and a radius [units of the file] for files that hold none, or
                        None; returns Curves, raises GroomError
    write : callable    given curves, an open binary file, and its path for messages; None: files of
                        the format cannot be written

    Raises
    ------
    GroomError          a suffix of furcl's own, or one that is none
    """
    if suffix in _BUILT_IN or not re.fullmatch(r"\.[^./A-Z]+", suffix):
        raise GroomError(
            f"format {suffix!r}: the suffix must begin with its only dot, be in lower case and "
            f"none of {', '.join(_BUILT_IN)}. Choose another."
        )
    _known[suffix] = Format(
        name=f"{suffix}, registered",
        suffixes=(suffix,),
        read=lambda path, asked: read(path, asked.default_radius),
        write=write,
        about=f"Read by {getattr(read, '__name__', 'a function')} of the user's.",
        points="as its reader says",
        radius="as its reader says",
        curved=True,
    )


def unregister(suffix: str) -> None:
    """Forget a format of one's own; GroomError if there is none of that suffix."""
    if suffix in _BUILT_IN or suffix not in _known:
        raise GroomError(f"format {suffix!r} was not registered; nothing to remove.")
    del _known[suffix]


def load_curves(
    path: str | os.PathLike[str],
    default_radius: float | None = None,
    radius_scale: float = 1.0,
    *,
    basis: str = "linear",
    points_per_strand: int | None = None,
) -> Curves:
    """Read a groom; docs/formats.md has the formats.

    Parameters
    ----------
    path : path                  its suffix says the format
    default_radius : float       radius [units of the file] where the file holds none, > 0
    radius_scale : float         factor on every radius, > 0
    basis : str                  what the points are of files that do not say: "linear", corners of
                                 polylines; "bezier", "bspline", "catmull-rom", control points of
                                 cubic curves, which become polylines (furcl.groom.flatten)
    points_per_strand : int      of files that do not say where strands begin, at least 2

    Returns
    -------
    Curves                       in the units and the axes of the file, which `units` says

    Raises
    ------
    GroomError                   a file that cannot be read or used: names the file, the byte
                                 offset, line or strand, what is allowed and a remedy
    """
    path = named(path, GroomError)
    _check_options(path, default_radius, radius_scale, basis, points_per_strand)
    form = _format(path, suffixes(), "reads")
    if form.curved and basis != "linear":
        raise GroomError(
            f"{path}: basis = {shown(basis)}: {form.name} files say themselves what their points "
            "are; leave it out."
        )
    try:
        check_regular(path)
        # What is too large, or no number, in a damaged file is refused with the points.
        with np.errstate(all="ignore"):
            curves = form.read(path, Asked(default_radius, basis, points_per_strand))
            if isinstance(curves, Strands):
                if basis != "linear":
                    _refuse_motion(path, curves, basis)
                    curves = flattened(curves, basis)
                curves = curves.checked()
    except OSError as error:
        raise GroomError(
            f"{path}: cannot be read: {error.strerror or error}. Check the path and its rights."
        ) from error
    except MemoryError as error:
        raise GroomError(
            f"{path}: does not fit into the memory of this process. Read a part of the groom, or "
            "raise the limit (ulimit -v)."
        ) from error
    if radius_scale == 1.0:
        return curves
    with np.errstate(over="ignore", under="ignore"):
        radii = curves.radii * np.float32(radius_scale)
    return adopted(
        curves.points if curves.steps is None else curves.steps,
        radii,
        curves.offsets,
        source=f"{path} (radius_scale = {radius_scale:g})",
        dropped=curves.dropped,
        attributes=curves.attributes,
        ignored=curves.ignored,
        units=curves.units,
        times=curves.times or None,
    )


def save_curves(curves: Curves, path: str | os.PathLike[str]) -> None:
    """Write a groom; the suffix says the format; the file appears whole or not at all.

    Reading it again gives the same points, radii and offsets, bit for bit, and those attributes
    that the format has a place for; others are named in the log.

    Raises
    ------
    GroomError                   an unknown suffix, a strand too long for the format, or a folder
                                 that cannot be written
    """
    path = named(path, GroomError)
    write = _format(path, suffixes(written=True), "writes").write
    assert write is not None
    try:
        with atomic_path(path) as temporary, temporary.open("xb") as file:
            write(curves, file, path)
    except OSError as error:
        raise GroomError(
            f"{path}: cannot be written: {error.strerror or error}. Check the folder, its rights "
            "and the space left."
        ) from error


def _refuse_motion(path: Path, strands: Strands, basis: str) -> None:
    """Refuse control points that move: their polylines would have other points at each time."""
    if time_steps(strands.points, strands.offsets) is not None:
        raise GroomError(
            f"{path}: basis = {shown(basis)}: points of shape {np.shape(strands.points)} move, and "
            f"only those of polylines are followed in time; write polylines and leave basis out."
        )


def _check_options(path, default_radius, radius_scale, basis, points_per_strand):
    for name, value in (("default_radius", default_radius), ("radius_scale", radius_scale)):
        if name == "default_radius" and value is None:
            continue
        if value is None or not is_number(value) or not 0.0 < value < float("inf"):
            given = f"{value:g}" if is_number(value) else shown(value)
            raise GroomError(
                f"{path}: {name} = {given}; it must be positive and finite. Correct it."
            )
    if basis not in BASES:
        raise GroomError(
            f"{path}: basis = {shown(basis)}; it must be one of {', '.join(BASES)}. Correct it."
        )
    n = points_per_strand
    if n is not None and (not is_whole(n) or n < 2):
        raise GroomError(
            f"{path}: points_per_strand = {shown(n)}; it must be a whole number of at least 2. "
            "Correct it."
        )


def _format(path: Path, known: tuple[str, ...], does: str) -> Format:
    """The format of a file: of the longest of its suffixes that is known."""
    name = path.name.lower()
    for suffix in sorted(known, key=len, reverse=True):
        if name.endswith(suffix):
            return _known[suffix]
    suffix = path.suffix.lower()
    remedy = NOT_READ.get(suffix, "convert the groom or rename the file") if does == "reads" else (
        "choose one of these"
    )  # fmt: skip
    raise GroomError(
        f"{path}: the suffix {suffix!r} is no groom format that furcl {does} "
        f"({', '.join(sorted(known))}): {remedy}."
    )
