"""Reading and writing grooms: .hair and .npz."""

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np

from furcl.errors import GroomError
from furcl.files import atomic_path, check_regular, named
from furcl.groom.curves import Curves, adopted
from furcl.groom.formats.npz import read_npz, write_npz
from furcl.groom.formats.yuksel_hair import read_hair, write_hair
from furcl.values import is_number, shown

Reader = Callable[[Path, float | None], Curves]
Writer = Callable[[Curves, BinaryIO, Path], None]

READERS: dict[str, Reader] = {".hair": read_hair, ".npz": read_npz}
WRITERS: dict[str, Writer] = {".hair": write_hair, ".npz": write_npz}
BUILT_IN = tuple(READERS)


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
    if suffix in BUILT_IN or not re.fullmatch(r"\.[^./A-Z]+", suffix):
        raise GroomError(
            f"format {suffix!r}: the suffix must begin with its only dot, be in lower case and "
            f"none of {', '.join(BUILT_IN)}. Choose another."
        )
    READERS[suffix] = read
    WRITERS.pop(suffix, None)
    if write:
        WRITERS[suffix] = write


def unregister(suffix: str) -> None:
    """Forget a format of one's own; GroomError if there is none of that suffix."""
    if suffix in BUILT_IN or suffix not in READERS:
        raise GroomError(f"format {suffix!r} was not registered; nothing to remove.")
    del READERS[suffix]
    WRITERS.pop(suffix, None)


def load_curves(
    path: str | os.PathLike[str],
    default_radius: float | None = None,
    radius_scale: float = 1.0,
) -> Curves:
    """Read a groom from a .hair or .npz file.

    Parameters
    ----------
    path : path                  its suffix says the format
    default_radius : float       radius [units of the file] where the file holds none, > 0
    radius_scale : float         factor on every radius, > 0

    Returns
    -------
    Curves                       in the units and the axes of the file

    Raises
    ------
    GroomError                   a file that cannot be read or used: names the file, the byte
                                 offset or strand, what is allowed and a remedy
    """
    path = named(path, GroomError)
    for name, value in (("default_radius", default_radius), ("radius_scale", radius_scale)):
        if name == "default_radius" and value is None:
            continue
        if value is None or not is_number(value) or not 0.0 < value < float("inf"):
            given = f"{value:g}" if is_number(value) else shown(value)
            raise GroomError(
                f"{path}: {name} = {given}; it must be positive and finite. Correct it."
            )
    read = READERS[_suffix(path, READERS, "reads")]
    try:
        check_regular(path)
        curves = read(path, default_radius)
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
        times=curves.times or None,
    )


def save_curves(curves: Curves, path: str | os.PathLike[str]) -> None:
    """Write a groom to a .hair or .npz file; the file appears whole or not at all.

    Reading it again gives the same points, radii, offsets and attributes, bit for bit. A .hair file
    keeps colours only, one a point; what it has no place for is named in the log.

    Raises
    ------
    GroomError                   an unknown suffix, a strand too long for the format, or a folder
                                 that cannot be written
    """
    path = named(path, GroomError)
    write = WRITERS[_suffix(path, WRITERS, "writes")]
    try:
        with atomic_path(path) as temporary, temporary.open("xb") as file:
            write(curves, file, path)
    except OSError as error:
        raise GroomError(
            f"{path}: cannot be written: {error.strerror or error}. Check the folder, its rights "
            "and the space left."
        ) from error


def _suffix(path, known, does):
    suffix = path.suffix.lower()
    if suffix not in known:
        raise GroomError(
            f"{path}: the suffix {suffix!r} is no groom format that furcl {does} "
            f"({', '.join(sorted(known))}). Convert the groom or rename the file."
        )
    return suffix
