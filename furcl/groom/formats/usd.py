"""Strands in USD: the BasisCurves of a stage, by usd-core."""

from __future__ import annotations

import importlib.util
import json
import logging
import os
import signal
import subprocess
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from furcl.errors import GroomError
from furcl.files import open_regular
from furcl.groom.attributes import RESERVED
from furcl.groom.curves import ADVICE, Curves
from furcl.groom.flatten import Places, Spans, places
from furcl.groom.formats.format import Asked, Format, Strands
from furcl.groom.formats.usd_stage import FALLBACK_COLOUR, pxr
from furcl.groom.units import Units
from furcl.paths import module_environment, python_command
from furcl.values import shown

log = logging.getLogger(__name__)

NEEDED = "USD needs usd-core; install it: pip install 'furcl[usd]'"
#: Beside what the libraries take: the file and its arrays. Of text usd-core's parser alone takes 5
#: to 7 times the file.
MEMORY_FACTOR, TEXT_FACTOR = 4, 9
SLACK_BYTES = 192 << 20
#: A damaged file may keep the library busy, or waiting, for ever: processor time of the process,
#: and by how much longer it may take on a machine with other work.
SECONDS, SECONDS_PER_MIB, PATIENCE = 60.0, 2.0, 20.0
_KINDS = {"linear", "cubic"}
_BASES = {"bezier": "bezier", "bspline": "bspline", "catmullRom": "catmull-rom"}
_WRAPS = ("nonperiodic", "periodic", "pinned")


def read_usd(path: Path, asked: Asked) -> Strands:
    """Read all visible BasisCurves of a stage, in world space, as polylines, at all of its times.

    Raises
    ------
    GroomError      the prim, and a remedy; usd-core is missing, or fails on the file
    """
    said, arrays = extracted(path)
    if "error" in said:
        raise GroomError(
            f"{path}: usd-core cannot read it: {shown(said['error'])}. It is damaged, or of "
            "another format; export it again."
        )
    if not said["prims"]:
        others = ", ".join(f"{n} {what}" for what, n in said["left_out"].items()) or "nothing else"
        raise GroomError(
            f"{path}: has no visible BasisCurves, but {others}. Export the strands as curves; in "
            "Blender, with hair and its curves switched on."
        )
    parts = [_prim(prim, number, arrays, asked, path) for number, prim in enumerate(said["prims"])]
    counts = np.concatenate([np.diff(_offsets(part)) for part in parts])
    attributes, ignored = _values(parts)
    own = [np.asarray(part.times, np.float64) for part in parts if part.times is not None]
    times = np.unique(np.concatenate(own)).tolist() if own else []
    return Strands(
        np.concatenate([_at_times(part, times) for part in parts], axis=1 if times else 0),
        np.concatenate([np.broadcast_to(part.radii, part.points.shape[-2]) for part in parts]),
        np.concatenate([[0], np.cumsum(counts)]),
        str(path),
        attributes,
        said["left_out"],
        ignored,
        Units(said["metres"], said["up_axis"]),
        times or None,
    )


def _at_times(part: Strands, times: list[float]) -> np.ndarray:
    """The points of a prim, of a groom that moves at its times: straight between the prim's own,
    and as the first and the last before and after them."""
    points = np.asarray(part.points)
    if not times:
        return points
    if part.times is None:
        return np.broadcast_to(points, (len(times), *points.shape))
    own = np.asarray(part.times, np.float64)
    if own.tolist() == times:
        return points
    place = np.interp(times, own, np.arange(len(own)))
    before = np.minimum(place.astype(np.int64), len(own) - 2)
    share = (place - before)[:, None, None].astype(np.float32)
    return points[before] * (1 - share) + points[before + 1] * share


def write_usd(curves: Curves, file: BinaryIO, path: Path) -> None:
    """Write one prim of linear BasisCurves, /strands, with z up if the groom does not say other.

    Raises
    ------
    GroomError      usd-core is missing; a groom that stands along x
    """
    _require()
    if curves.units.up_axis == "x":
        raise GroomError(f"{path}: USD has y or z up, and the groom says x; turn it (--up x).")
    Sdf, Usd, UsdGeom, Vt = (pxr(name) for name in ("Sdf", "Usd", "UsdGeom", "Vt"))
    layer = Sdf.Layer.CreateAnonymous(".usda" if path.suffix.lower() == ".usda" else ".usdc")
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, (curves.units.up_axis or "z").upper())
    if curves.units.metres is not None:
        UsdGeom.SetStageMetersPerUnit(stage, curves.units.metres)
    prim = UsdGeom.BasisCurves.Define(stage, "/strands")
    stage.SetDefaultPrim(prim.GetPrim())
    prim.CreateTypeAttr("linear")
    prim.CreateWrapAttr("nonperiodic")
    counts = np.diff(curves.offsets).astype(np.int32)
    prim.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    points = prim.CreatePointsAttr()
    if curves.steps is None:
        points.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(curves.points)))
    else:
        stage.SetStartTimeCode(curves.times[0])
        stage.SetEndTimeCode(curves.times[-1])
        for time, step in zip(curves.times, curves.steps, strict=True):
            points.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(step)), Usd.TimeCode(time))
    one = curves.one_radius
    widths = (curves.radii[:1] if one else curves.radii) * np.float32(2.0)
    prim.CreateWidthsAttr(Vt.FloatArray.FromNumpy(widths))
    prim.SetWidthsInterpolation("constant" if one else "vertex")
    lo, hi = curves.bounds()
    extent = np.array([lo, hi], np.float32)
    prim.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(extent))
    left_out = []
    for name, values in curves.attributes.items():
        if not name.isidentifier() or not name.isascii():
            left_out.append(name)
            continue
        types = Sdf.ValueTypeNames
        kind = types.Color3fArray if name == "colours" else types.Float3Array
        primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
            "displayColor" if name == "colours" else name,
            types.FloatArray if values.ndim == 1 else kind,
            "vertex" if len(values) == curves.n_points else "uniform",
        )
        array = Vt.FloatArray if values.ndim == 1 else Vt.Vec3fArray
        primvar.Set(array.FromNumpy(np.ascontiguousarray(values)))
    if not layer.Export(file.name):
        raise OSError(None, "usd-core cannot write it")
    if left_out:
        log.warning(
            "%s: names of USD are letters, digits and _; %s is left out", path, ", ".join(left_out)
        )


def _require() -> None:
    if importlib.util.find_spec("pxr") is None:
        raise GroomError(NEEDED)


def extracted(path: Path, what: str = "curves") -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What another process finds in the file (furcl.groom.formats.usd_stage) of curves or meshes.

    Raises
    ------
    GroomError      usd-core is missing, or fails on the file
    """
    _require()
    size = path.stat().st_size
    file = os.memfd_create("furcl-usd", os.MFD_CLOEXEC)
    try:
        seconds = SECONDS + SECONDS_PER_MIB * size / 2**20
        n_bytes = memory_bytes(path)
        request = json.dumps([str(path.absolute()), file, n_bytes, seconds, what])
        try:
            ended = subprocess.run(
                python_command("-m", "furcl.groom.formats.usd_stage", request),
                env=module_environment(OPENBLAS_NUM_THREADS="1"),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                pass_fds=(file,),
                check=False,
                timeout=PATIENCE * seconds,
            )
        except subprocess.TimeoutExpired as error:
            raise GroomError(
                f"{path}: usd-core was not done with it after {error.timeout:.0f} s; it is "
                "damaged, export it again."
            ) from None
        if ended.returncode == -signal.SIGXCPU:
            raise GroomError(
                f"{path}: usd-core was not done with it after {seconds:.0f} s of processor time; "
                "it is damaged, export it again."
            )
        if ended.returncode != 0:
            said = ended.stderr.decode("utf-8", "replace").strip().splitlines() or ["nothing"]
            code = ended.returncode
            how = f"crashes on it (signal {-code})" if code < 0 else f"fails: {shown(said[-1])}"
            if "MemoryError" in said[-1] or "bad_alloc" in said[-1]:
                how = f"takes more than {n_bytes >> 20} MiB"
            raise GroomError(f"{path}: usd-core {how}; it is damaged, export it again.")
        return shared_result(file)
    finally:
        os.close(file)


def memory_bytes(path: Path) -> int:
    """What usd-core may take of a file."""
    with open_regular(path) as file:
        text = file.read(5) == b"#usda"
    return (TEXT_FACTOR if text else MEMORY_FACTOR) * path.stat().st_size + SLACK_BYTES


def shared_result(file: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What furcl.groom.formats.usd_stage has written to an open file."""
    with os.fdopen(os.dup(file), "rb") as shared:
        shared.seek(0)
        with np.load(shared, allow_pickle=False) as found:
            arrays = dict(found)
    return json.loads(bytes(arrays.pop("said"))), arrays


class _Expander:
    """How values of a prim come to the points of its polylines."""

    def __init__(self, prim, n_points, counts, path) -> None:
        self._where = f"{path}: {prim['path']}"
        offsets = np.concatenate([[0], np.cumsum(counts)])
        self.spans: Spans | None = None
        self.places: Places | None = None
        self.offsets = offsets
        self.sizes = {"constant": 1, "uniform": len(counts)}
        self.sizes |= {"vertex": n_points, "varying": n_points}
        if prim["type"] == "cubic":
            self.spans = Spans(offsets, _BASES[prim["basis"]], prim["wrap"], self._where)
            self.sizes["varying"] = int(self.spans.varying_offsets[-1])
        elif prim["wrap"] == "periodic":
            raise GroomError(
                f"{self._where}: closed linear curves are no strands; make them nonperiodic."
            )

    def kind(self, name: str, values: np.ndarray, said: str) -> str:
        """Of what the values are; refuses a number of them that does not fit."""
        n = len(values)
        kind = "vertex" if said == "faceVarying" else said
        if n != self.sizes.get(kind):
            # Some exporters say another interpolation than they write.
            fitting = [kind for kind, size in self.sizes.items() if size == n]
            if not fitting:
                raise GroomError(
                    f"{self._where}: {n} {name} of interpolation {shown(said)}; expected "
                    f"{self.sizes.get(kind, self.sizes['vertex'])}. Export the curves again."
                )
            kind = fitting[0]
        return kind

    def bezier(self, values: np.ndarray, kind: str) -> np.ndarray:
        """Bezier coefficients of values of the control points or the ends of spans."""
        assert self.spans is not None
        return self.spans.bezier(values) if kind == "vertex" else self.spans.bezier_of_ends(values)

    def at_points(self, values: np.ndarray, kind: str) -> np.ndarray:
        """Values of all points."""
        if kind == "constant":
            return np.broadcast_to(values[0], (self.offsets[-1], *values.shape[1:]))
        if kind == "uniform":
            return np.repeat(values, np.diff(self.offsets), axis=0)
        if self.places is None:
            return values
        return self.places.of(self.bezier(values, kind))


def _prim(prim, number, arrays, asked: Asked, path: Path) -> Strands:
    """The strands of a prim."""
    where = f"{path}: {prim['path']}"
    counts = arrays.get(f"{number}/counts", np.zeros(0, np.int64))
    points = arrays.get(f"{number}/points", np.zeros((0, 3), np.float32))
    known = prim["type"] in _KINDS and prim["wrap"] in _WRAPS
    if not known or (prim["type"] == "cubic" and prim["basis"] not in _BASES):
        raise GroomError(
            f"{where}: curves of type {shown(prim['type'])}, basis {shown(prim['basis'])}, wrap "
            f"{shown(prim['wrap'])}; read are linear and cubic ones of {', '.join(_BASES)} that "
            f"are {', '.join(_WRAPS)}. Convert them."
        )
    times, n_points = arrays.get(f"{number}/times"), points.shape[-2]
    if not len(counts) or counts.min() < 1 or counts.sum() != n_points:
        least = f", the least of {counts.min()}" if len(counts) else ""
        raise GroomError(
            f"{where}: {len(counts)} curves of together {counts.sum()} points{least}, and "
            f"{n_points} points; curveVertexCounts must add up. Export the curves again."
        )
    if prim.get("points_change"):
        log.warning("%s: its points change in number with time; it keeps still as at first", where)
    of = _Expander(prim, n_points, counts, path)
    widths = arrays.get(f"{number}/widths")
    if (widths is None or not widths.any()) and asked.default_radius is None:
        raise GroomError(f"{where}: the curves have no widths. {ADVICE}")
    if widths is None or not widths.any():
        radii, kind = np.full(1, asked.default_radius), "constant"
    else:
        with np.errstate(all="ignore"):  # what is not finite is refused with the radii
            radii = widths.astype(np.float64) * (0.5 * prim["width_scale"])
        kind = of.kind("widths", radii, prim["widths"])
    if of.spans is None:
        found, at = points, of.at_points(radii, kind)
    else:
        steps = [of.spans.bezier(step) for step in (points if points.ndim == 3 else [points])]
        if kind in ("constant", "uniform"):
            each = radii if kind == "uniform" else np.broadcast_to(radii, len(counts))
            curve_radii = np.repeat(each[of.spans.strand][:, None], 4, axis=1)
        else:
            curve_radii = of.bezier(radii, kind)
        at_places = of.places = places(of.spans, steps, curve_radii)
        of.offsets = at_places.offsets
        found = np.stack([at_places.of(step) for step in steps])
        found = found if points.ndim == 3 else found[0]
        at = np.maximum(at_places.of(curve_radii), 0.0)
    if prim["ribbons"]:
        log.warning("%s: ribbons with normals are taken as fibres of that width", where)
    values = {}
    for name, said in prim["values"].items():
        array = arrays[f"{number}/value {name}"]
        try:
            kind = of.kind(name, array, said)
        except GroomError:
            if name == "displayColor":
                raise
            continue
        strands = kind in ("uniform", "constant")
        values[name] = (
            (
                np.broadcast_to(array, (len(counts), *array.shape[1:]))
                if kind == "constant"
                else array
            )
            if strands
            else of.at_points(array, kind)
        )
    if "displayColor" not in values and prim["material"] is not None:
        values["displayColor"] = np.broadcast_to(np.float32(prim["material"]), (len(counts), 3))
    return Strands(found, at, of.offsets, where, values, times=times)


def _offsets(part: Strands) -> np.ndarray:
    """Offsets of strands, which every prim has."""
    assert part.offsets is not None
    return part.offsets


def _values(parts: list[Strands]):
    """Values of all prims together; names of those that some lack, but for colours."""
    names = dict.fromkeys(name for part in parts for name in part.attributes)
    found, ignored = {}, []
    for name in names:
        public = "colours" if name == "displayColor" else name
        if name == "displayColor":
            for part in parts:
                grey = np.broadcast_to(
                    np.array(FALLBACK_COLOUR, np.float32), (len(_offsets(part)) - 1, 3)
                )
                part.attributes = {"displayColor": grey, **part.attributes}
        arrays = [np.asarray(part.attributes[name]) for part in parts if name in part.attributes]
        fits = len(arrays) == len(parts) and len({a.shape[1:] for a in arrays}) == 1
        if not fits or public in RESERVED or (public == "colours" and arrays[0].ndim != 2):
            ignored.append(name)
            continue
        of_strands = [len(a) == len(_offsets(p)) - 1 for a, p in zip(arrays, parts, strict=True)]
        if not all(of_strands):
            arrays = [
                np.repeat(a, np.diff(_offsets(p)), axis=0) if strands else a
                for a, p, strands in zip(arrays, parts, of_strands, strict=True)
            ]
        found[public] = np.concatenate(arrays)
    return found, ignored


FORMAT = Format(
    name="USD",
    suffixes=(".usd", ".usda", ".usdc"),
    read=read_usd,
    write=write_usd,
    about="Universal Scene Description, by usd-core: what Blender, Houdini and Maya exchange.",
    points="all visible BasisCurves of the stage, in world space: linear, or cubic of basis "
    "bezier, bspline or catmullRom, nonperiodic, periodic or pinned. Points and transformations at "
    "all of their times, in time codes; of other values that change with time, the first. Written "
    "as linear curves. In memory text, .usda, is 5 to 7 times the file while it is read, by "
    "usd-core's parser, and .usdc about twice (`python bench/usd_memory.py`).",
    radius="half of the widths, of any interpolation, scaled with the transformation",
    units="`metersPerUnit` if it is there; `upAxis`, y if it is not there",
    kept="`primvars:displayColor` as colours, else the colour that the material's surface shader "
    "says; other primvars of numbers that all prims have",
    left_out="NURBS and Hermite curves, point instancers, guides and what is invisible are "
    "counted; texture coordinates. Meshes are shown beside the strands where the file is rendered "
    "without a scene; in one, `mesh.NAME.file` names it again. Ribbons are read as fibres.",
    curved=True,
    extra="usd",
)
