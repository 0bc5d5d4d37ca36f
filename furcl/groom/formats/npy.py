"""numpy's .npy: one array (S, N, 3), S strands of N points, or (S, N, 4) with radii."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from furcl.errors import GroomError
from furcl.groom.curves import ADVICE
from furcl.groom.formats.format import Asked, Format, Strands
from furcl.memory import require_memory
from furcl.values import shown


def read_npy(path: Path, asked: Asked) -> Strands:
    """Read an array of strands; nothing is ever unpickled.

    Raises
    ------
    GroomError      its shape or type, and what is expected
    """
    try:
        # The shape that a header claims is compared with the file's length, without reading it.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # numpy reads a header as Python, whose parser raises many things
        raise GroomError(
            f"{path}: no whole .npy file of numbers: {shown(str(error))}. Write it with numpy.save."
        ) from error
    if not isinstance(array, np.ndarray):
        raise GroomError(
            f"{path}: holds several arrays: name it .npz, or save one with numpy.save."
        )
    if array.dtype.kind not in "fiu":
        raise GroomError(f"{path}: has type {array.dtype}; expected real numbers. Convert it.")
    each = asked.points_per_strand
    if array.ndim == 2 and each and array.shape[1] in (3, 4) and array.shape[0] % each == 0:
        array = array.reshape(-1, each, array.shape[1])
    if array.ndim != 3 or array.shape[2] not in (3, 4):
        raise GroomError(
            f"{path}: has shape {array.shape}; expected (S, N, 3), S strands of N points x y z, or "
            "(S, N, 4) with a radius. Of points (M, 3) give points_per_strand "
            "(--points-per-strand), or write .npz with counts."
        )
    if array.shape[1] < 2 or array.shape[0] == 0:
        raise GroomError(
            f"{path}: has shape {array.shape}: {array.shape[0]} strands of {array.shape[1]} "
            "points; at least one of 2 points is needed."
        )
    require_memory(path, n_bytes=4 * array.nbytes, error=GroomError)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        points = np.ascontiguousarray(array[:, :, :3], np.float32)
        radii = np.float32(0.0)
        if array.shape[2] == 4:
            radii = np.ascontiguousarray(array[:, :, 3], np.float32)
    if not radii.any():
        if asked.default_radius is None:
            raise GroomError(f"{path}: an array (S, N, 3) has no radii. {ADVICE}")
        radii = np.float32(asked.default_radius)
    return Strands(points, radii, None, str(path))


FORMAT = Format(
    name="numpy's .npy",
    suffixes=(".npy",),
    read=read_npy,
    write=None,
    about="One array, written by `numpy.save`, as machine learning on strands has them.",
    points="(S, N, 3): S strands of N points; or (M, 3) with `points_per_strand`",
    radius="the fourth number of a point, of (S, N, 4)",
    left_out="other shapes are refused: `.npz` has strands of different lengths and values.",
)
