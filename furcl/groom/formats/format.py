"""What a groom format is: how it is told, read and written, and what its page says of it."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.groom.curves import Curves, adopted
from furcl.groom.units import NO_UNITS, Units

#: What the points of a file are that does not say it.
BASES = ("linear", "bezier", "bspline", "catmull-rom")


@dataclass(frozen=True)
class Asked:
    """What whoever reads a file says beside its name.

    Attributes
    ----------
    default_radius : float or None      where the file has none, or only 0 [unit of the file]
    basis : str                         one of BASES, for files that do not say
    points_per_strand : int or None     for files that do not say where strands begin
    """

    default_radius: float | None = None
    basis: str = "linear"
    points_per_strand: int | None = None


@dataclass(eq=False)
class Strands:
    """What a reader finds: arrays that nobody else keeps, as of furcl.groom.curves.adopted."""

    points: NDArray[np.floating]
    radii: NDArray[Any] | np.floating | float
    offsets: NDArray[np.integer] | None
    source: str
    attributes: Mapping[str, ArrayLike] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)
    ignored: Sequence[str] = ()
    units: Units = NO_UNITS
    times: ArrayLike | None = None

    def checked(self) -> Curves:
        """A groom of them; GroomError as `Curves.from_arrays`."""
        return adopted(
            self.points,
            self.radii,
            self.offsets,
            source=self.source,
            attributes=self.attributes,
            dropped=self.dropped,
            ignored=self.ignored,
            units=self.units,
            times=self.times,
        )


@dataclass(frozen=True)
class Format:
    """A groom format. Its texts are what docs/formats.md says of it.

    Attributes
    ----------
    name : str          e.g. "Yuksel's .hair"
    suffixes : tuple    in lower case, with their dots
    read : callable     given path and Asked; returns Strands or Curves, raises GroomError
    write : callable    given curves, an open binary file and its path for messages; None: files of
                        the format are not written
    about : str         what such a file is, and who writes it
    points : str        what is taken for a strand
    radius : str        where radii come from
    units : str         what the file says of units and axes
    kept : str          values of strands and points that are read, and written
    left_out : str      what is not read, or refused
    curved : bool       whether the file says itself what its points are of (BASES)
    extra : str         furcl's extra that is needed, or ""
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, Asked], Strands | Curves]
    write: Callable[[Curves, BinaryIO, Path], None] | None
    about: str
    points: str
    radius: str
    units: str = "says none"
    kept: str = "none"
    left_out: str = ""
    curved: bool = False
    extra: str = ""


def mapped(path: Path) -> mmap.mmap:
    """The bytes of a file with something in it, which are read where they are looked at."""
    with path.open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
