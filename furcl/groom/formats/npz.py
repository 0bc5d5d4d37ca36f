"""Grooms in numpy's .npz: the arrays points, radii or radius, offsets or counts, and attributes."""

import io
import math
import struct
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy

from furcl.errors import GroomError
from furcl.groom.attributes import RESERVED, value_rows
from furcl.groom.curves import ADVICE, Curves
from furcl.groom.formats.format import Asked, Format, Strands
from furcl.memory import require_memory
from furcl.values import shown

MAX_MEMBERS = 10_000
# The end of a zip file: a record and a comment, and two records of larger files before it.
END_BYTES, END64_BYTES = 22, 56 + 20
LONGEST_END = END64_BYTES + END_BYTES + 65535
# numpy reads no longer header of an array; one may claim 4 GB.
HEADER_BYTES = 1 << 14
# deflate cannot pack tighter, so a member that claims more is lying.
MAX_DEFLATE_RATIO = 1032


def read_npz(path: Path, asked: Asked) -> Strands:
    """Read an .npz groom. Nothing is ever unpickled.

    points (N, 3); radii (N,) or a scalar, also under the name radius; offsets (S + 1,) or
    counts (S,), any integers. Or points (S, K, 3), S strands of K, with radii (S, K) or a scalar
    and no offsets or counts. Points of a groom that moves have an axis of time in front, (T, N, 3)
    or (T, S, K, 3), and may have times (T,), else 0 to 1, evenly. Numbers under other names are
    attributes where they have a value, or three, for each point or strand
    (furcl.groom.attributes); other members are not read, and named in `Curves.ignored`. The sizes
    of arrays that their headers claim are compared with the file and with the memory before
    anything is allocated.

    Parameters
    ----------
    path : Path                  the file
    asked : Asked                its default_radius is used where the file has neither radii nor
                                 radius, or only 0

    Raises
    ------
    GroomError                   the file's name, the array or strand, and a remedy
    """
    try:
        _check_listed(path)
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
            arrays = {
                name: _read_member(archive, name, path)
                for name in RESERVED
                if f"{name}.npy" in members
            }
            others = [name for name in members if name.removesuffix(".npy") not in arrays]
            fitting = [name for name in others if _is_attribute(archive, name, arrays)]
            attributes = {
                name.removesuffix(".npy"): _read_member(archive, name.removesuffix(".npy"), path)
                for name in fitting
            }
    except (GroomError, OSError):
        raise
    except Exception as error:  # zipfile raises whatever its parts raise on damaged files
        raise GroomError(
            f"{path}: not a whole .npz (zip) file: {shown(str(error))}. It is truncated or of "
            "another format; fetch or write it again with numpy.savez."
        ) from error
    if "points" not in arrays:
        raise GroomError(
            f"{path}: no array 'points'; expected points (N, 3), radii (N,) or scalar, and "
            "offsets (S+1,) or counts (S,). Save them under these names with numpy.savez."
        )
    return Strands(
        arrays["points"],
        _radii(arrays, asked.default_radius, path),
        _offsets(arrays, path),
        str(path),
        attributes,
        times=arrays.get("times"),
        ignored=[name.removesuffix(".npy") for name in others if name not in fitting],
    )


def write_npz(curves: Curves, file: BinaryIO, path: Path) -> None:
    """Write points, radii, offsets, attributes and times to an open binary file."""
    arrays = {"points": curves.points, "radii": curves.radii, "offsets": curves.offsets}
    if curves.steps is not None:
        arrays |= {"points": curves.steps, "times": np.array(curves.times)}
    np.savez(file, allow_pickle=False, **arrays, **curves.attributes)


def _is_attribute(archive, member, arrays):
    """Whether a member holds numbers for each point or strand; `colours` always wants to be one."""
    points = arrays.get("points")
    if points is None or not member.endswith(".npy"):
        return False
    if member == "colours.npy":
        return True
    try:
        with archive.open(member) as file:
            shape, dtype, _ = _read_header(file)
    except Exception:  # of whatever it is, it is no array of numbers
        return False
    counts, offsets = arrays.get("counts"), arrays.get("offsets")
    alone = counts is None and offsets is None
    grid = points.shape[-3:-1] if points.ndim >= 3 and alone else None
    n_strands = (
        grid[0] if grid
        else len(np.atleast_1d(counts)) if counts is not None
        else max(np.size(offsets) - 1, 0) if offsets is not None
        else 0
    )  # fmt: skip
    n_points = math.prod(grid) if grid else points.shape[-2] if points.ndim > 1 else points.size
    rows = value_rows(shape, n_strands, n_points, grid)
    return dtype.kind in "fiub" and rows is not None


def _check_listed(path):
    """Refuse a zip file that lists more members than any groom has, before they are."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - LONGEST_END, 0))
        end = file.read()
    # Where Python's zipfile looks: without a comment, else before one.
    for at in {len(end) - END_BYTES, end.rfind(b"PK\5\6")}:
        if end[at : at + 4] != b"PK\5\6" or at < 0 or at + END_BYTES > len(end):
            continue
        (count,) = struct.unpack_from("<H", end, at + 10)
        larger = at - END64_BYTES
        if larger >= 0 and end[larger : larger + 4] == b"PK\6\6":
            (count,) = struct.unpack_from("<Q", end, larger + 32)
        if count > MAX_MEMBERS:
            raise GroomError(
                f"{path}: lists {count} arrays; at most {MAX_MEMBERS} are read. Write those of the "
                "groom alone."
            )


def _read_member(archive, name, path):
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise GroomError(
            f"{path}: array '{name}' is packed by method {info.compress_type} of zip; numpy.savez "
            "and savez_compressed pack by 0 or 8. Write the file with one of them."
        )
    if info.file_size > MAX_DEFLATE_RATIO * info.compress_size + 1024:
        raise GroomError(
            f"{path}: array '{name}' claims {info.file_size} bytes but holds {info.compress_size} "
            "packed ones; the file is damaged, write it again."
        )
    require_memory(path, n_bytes=4 * info.file_size, error=GroomError)
    try:
        with archive.open(info) as file:
            shape, dtype, n_header = _read_header(file)
        claimed = math.prod(shape) * dtype.itemsize + n_header
        if claimed != info.file_size:
            raise GroomError(
                f"{path}: array '{name}' of shape {shape} and type {dtype} claims {claimed} bytes; "
                f"{info.file_size} are there. The file is damaged, write it again."
            )
        with archive.open(info) as file:
            return npy.read_array(file, allow_pickle=False)
    except (GroomError, OSError):
        raise
    except Exception as error:  # numpy reads a header as Python, whose parser raises many things
        raise GroomError(
            f"{path}: array '{name}' cannot be read: {shown(str(error))}. Save it as plain numbers."
        ) from error


def _read_header(member):
    """Shape, type and number of bytes of an array's header."""
    file = io.BytesIO(member.read(HEADER_BYTES))
    version = npy.read_magic(file)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(file)
    if dtype.hasobject:
        raise ValueError("it holds Python objects, which are never loaded")
    if not all(type(size) is int and size >= 0 for size in shape):
        raise ValueError(f"its shape is {shown(shape)}, which is none")
    return shape, dtype, file.tell()


def _radii(arrays, default_radius, path):
    radii = arrays.get("radii", arrays.get("radius", default_radius))
    if radii is None:
        raise GroomError(
            f"{path}: no array 'radii' or 'radius'; one radius per point or a scalar is needed. "
            f"{ADVICE}"
        )
    if default_radius is not None and np.asarray(radii).dtype.kind in "fiu" and not np.any(radii):
        return default_radius
    return radii


def _offsets(arrays, path):
    points = arrays["points"]
    both = [name for name in ("offsets", "counts") if name in arrays]
    if points.ndim == 4 and both:
        n, per_strand = points.shape[1:3]
        raise GroomError(
            f"{path}: points of shape {points.shape} say themselves where strands begin, and "
            f"there is {' and '.join(both)}. Leave that out, or give points as "
            f"({len(points)}, {n * per_strand}, 3)."
        )
    if points.ndim in (3, 4) and not both:
        return None
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise GroomError(
            f"{path}: points has shape {points.shape}; expected (N, 3), one row x y z per point, "
            f"or (T, N, 3), at T times."
        )
    if "counts" not in arrays:
        if "offsets" not in arrays:
            raise GroomError(
                f"{path}: neither 'offsets' nor 'counts'; furcl needs to know where strands begin. "
                "Add counts (S,), the number of points of each strand."
            )
        return arrays["offsets"]
    counts = arrays["counts"]
    if counts.ndim != 1 or counts.dtype.kind not in "iu":
        raise GroomError(
            f"{path}: counts has shape {counts.shape} and type {counts.dtype}; expected a flat "
            "array of integers, the number of points of each strand."
        )
    n_points = points.shape[-2]
    if counts.size and not 0 <= int(counts.min()) <= int(counts.max()) <= n_points:
        raise GroomError(
            f"{path}: counts run from {counts.min()} to {counts.max()}; each must be between 2 and "
            f"the number of points, {n_points}. Repair the export."
        )
    offsets = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    if offsets[-1] != n_points and points.ndim == 3 and offsets[-1] == points.size // 3:
        raise GroomError(
            f"{path}: counts make {offsets[-1]} points, and points of shape {points.shape} beside "
            f"counts are {len(points)} time steps of {n_points}. If these are strands, they say "
            f"themselves where strands begin: leave counts out, or give points as (N, 3)."
        )
    if offsets[-1] != n_points:
        raise GroomError(
            f"{path}: the counts do not add up: they make {offsets[-1]} points, 'points' has "
            f"{n_points}. Repair the export."
        )
    if "offsets" in arrays and not np.array_equal(arrays["offsets"], offsets):
        raise GroomError(
            f"{path}: 'offsets' and 'counts' disagree; keep the one that is right and remove the "
            "other."
        )
    return offsets


FORMAT = Format(
    name="numpy's .npz",
    suffixes=(".npz",),
    read=read_npz,
    write=write_npz,
    about="Arrays by name, written by `numpy.savez` or `savez_compressed`: the neutral form.",
    points="`points` (N, 3) with `offsets` (S + 1,) or `counts` (S,); or `points` (S, K, 3), S "
    "strands of K points",
    radius="`radii` (N,), (S, K) or a scalar, also called `radius`",
    kept="every other array of numbers, (N,), (N, 3), (S,) or (S, 3)",
    left_out="arrays of other shapes are named by `furcl info`. Nothing is unpickled.",
)
