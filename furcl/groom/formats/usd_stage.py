"""What a USD stage has of curves or meshes, by usd-core, in a process of its own.

`python -m furcl.groom.formats.usd_stage REQUEST`: a damaged file may crash the library, make it
take any memory, or hang. The arrays go into memory that both processes share, as .npz.
"""

from __future__ import annotations

import itertools
import json
import os
import resource
import sys
import zipfile
from importlib import import_module
from typing import Any, BinaryIO

import numpy as np

from furcl.groom.formats.usd_meshes import extract_meshes, visible_meshes
from furcl.memory import limit_memory

#: Names of inputs of surface shaders that hold their colour.
COLOUR_INPUTS = (
    "diffuseColor",
    "base_color",
    "baseColor",
    "diffuse_color",
    "diffuse_reflection_color",
)
#: Shown where a prim has no colour and others do, as USD's own viewers show it.
FALLBACK_COLOUR = (0.18, 0.18, 0.18)
#: As of furcl.scene.motion, which follows turns alike.
LARGEST_TURN_DEG = 4.0
#: Points.
PLACED_AT_ONCE = 1 << 16


def pxr(module: str) -> Any:
    """A module of usd-core, of which type checkers know nothing."""
    return import_module(f"pxr.{module}")


def extract(path: str, what: str = "curves") -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What is said of the stage and its curves, or "meshes", and arrays by number and name; of its
    "kinds" only whether it has meshes.

    Points and transformations are taken at all times that the file has, of other values that change
    with time the first ones.

    Raises
    ------
    Exception       whatever usd-core raises of a damaged file
    """
    Usd, UsdGeom = pxr("Usd"), pxr("UsdGeom")
    stage = Usd.Stage.Open(path)
    time = Usd.TimeCode.EarliestTime()
    transforms = UsdGeom.XformCache(time)
    said: dict[str, Any] = {
        "up_axis": str(UsdGeom.GetStageUpAxis(stage)).lower(),
        "metres": UsdGeom.GetStageMetersPerUnit(stage)
        if stage.HasAuthoredMetadata("metersPerUnit")
        else None,
        "prims": [],
        "meshes": [],
        "left_out": {},
    }
    arrays: dict[str, np.ndarray] = {}
    if what == "kinds":
        said["has_meshes"] = any(True for _ in visible_meshes(stage, time))
        return said, arrays
    if what == "meshes":
        extract_meshes(stage, time, said, arrays)
        return said, arrays

    def leave_out(why: str) -> None:
        said["left_out"][why] = said["left_out"].get(why, 0) + 1

    prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            leave_out("point_instancers")
            prims.PruneChildren()
        elif prim.IsA(UsdGeom.Mesh):
            leave_out("meshes")
        elif prim.IsA(UsdGeom.Curves):
            imageable = UsdGeom.Imageable(prim)
            if not prim.IsA(UsdGeom.BasisCurves):
                leave_out(f"{prim.GetTypeName()}_prims")
            elif imageable.ComputePurpose() not in ("default", "render"):
                leave_out("guide_or_proxy_prims")
            elif imageable.ComputeVisibility(time) == "invisible":
                leave_out("invisible_prims")
            else:
                matrix = np.array(transforms.GetLocalToWorldTransform(prim))
                number = len(said["prims"])
                said["prims"].append(_curves(prim, time, matrix, number, arrays))
                said["prims"][number] |= _motion(prim, number, arrays)
    return said, arrays


def _motion(prim, number: int, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Puts the points (T, n, 3) of a prim that moves in the place of its first ones, and its times
    beside them; says whether its points change in number, in which case it is left as it is."""
    Usd, UsdGeom = pxr("Usd"), pxr("UsdGeom")
    of_points = UsdGeom.BasisCurves(prim).GetPointsAttr()
    times = sorted({*of_points.GetTimeSamples(), *_transform_times(prim)})
    if len(times) < 2 or f"{number}/points" not in arrays:
        return {}
    n_points = len(arrays[f"{number}/points"])
    steps = np.empty((len(times), n_points, 3), np.float32)
    for i, moment in enumerate(times):
        code = Usd.TimeCode(moment)
        matrix = np.array(UsdGeom.XformCache(code).GetLocalToWorldTransform(prim))
        points = np.asarray(of_points.Get(code)).reshape(-1, 3)
        if len(points) != n_points:
            return {"points_change": True}
        _place(points, matrix, steps[i])
    arrays[f"{number}/points"], arrays[f"{number}/times"] = steps, np.array(times, np.float64)
    return {}


def _transform_times(prim) -> list[float]:
    """The times of a prim's transformation and of those that it is below, and as many in between
    that it turns by no more than LARGEST_TURN_DEG from one to the next."""
    Usd, UsdGeom = pxr("Usd"), pxr("UsdGeom")
    given: set[float] = set()
    above = prim
    while above:
        if above.IsA(UsdGeom.Xformable):
            given |= set(UsdGeom.Xformable(above).GetTimeSamples())
        above = above.GetParent()
    times = sorted(given)
    found = times[:1]
    for a, b in itertools.pairwise(times):
        turns = [_rotation(UsdGeom.XformCache(Usd.TimeCode(t)), prim) for t in (a, b)]
        cosine = 0.5 * (np.trace(turns[0].T @ turns[1]) - 1.0)
        turn = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        n = max(1, int(np.ceil(turn / LARGEST_TURN_DEG)))
        found += [a + (b - a) * i / n for i in range(1, n)] + [b]
    return found


def _rotation(transforms, prim) -> np.ndarray:
    """The rotation nearest to a prim's transformation, none where that has no volume."""
    matrix = np.array(transforms.GetLocalToWorldTransform(prim))[:3, :3]
    if not np.isfinite(matrix).all():
        return np.eye(3)
    left, _, right = np.linalg.svd(matrix)
    return left @ right


def _curves(prim, time, matrix, number, arrays) -> dict[str, Any]:
    UsdGeom = pxr("UsdGeom")

    curves = UsdGeom.BasisCurves(prim)

    def keep(name, value, dtype):
        if value is not None:
            arrays[f"{number}/{name}"] = np.asarray(value, dtype)

    def keep_numbers(name, value, dtype):
        # A stage may say another type than the schema's: one number, or several in a row.
        if value is not None:
            keep(name, np.asarray(value, dtype).reshape(-1), dtype)

    keep_numbers("counts", curves.GetCurveVertexCountsAttr().Get(time), np.int64)
    points = curves.GetPointsAttr().Get(time)
    if points is not None:
        points = np.asarray(points).reshape(-1, 3)
        keep("points", _place(points, matrix, np.empty(points.shape, np.float32)), np.float32)
    keep_numbers("widths", curves.GetWidthsAttr().Get(time), np.float32)
    values = {}
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithValues():
        name = primvar.GetPrimvarName()
        value = primvar.ComputeFlattened(time)
        if value is None or name in ("st", "uv"):
            continue
        try:
            array = np.asarray(value, np.float32)
        except (TypeError, ValueError):
            continue  # of words, or of numbers in other shapes
        if array.ndim == 0 or (array.ndim == 1 and not primvar.GetAttr().GetTypeName().isArray):
            array = array[None]
        if array.ndim == 1 or (array.ndim == 2 and array.shape[1] == 3):
            keep(f"value {name}", array, np.float32)
            values[name] = str(primvar.GetInterpolation())
    with np.errstate(all="ignore"):
        scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    return {
        "path": str(prim.GetPath()),
        "type": str(curves.GetTypeAttr().Get(time)),
        "basis": str(curves.GetBasisAttr().Get(time)),
        "wrap": str(curves.GetWrapAttr().Get(time)),
        "widths": str(curves.GetWidthsInterpolation()),
        "ribbons": bool(curves.GetNormalsAttr().HasAuthoredValue()),
        "width_scale": scale,
        "values": values,
        "material": None if "displayColor" in values else _material_colour(prim, time),
    }


def _place(points: np.ndarray, matrix: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Points (n, 3) as a matrix transforms them, into `out`; a part at a time, because they are in
    float64 meanwhile."""
    for begin in range(0, len(points), PLACED_AT_ONCE):
        part = slice(begin, begin + PLACED_AT_ONCE)
        with np.errstate(all="ignore"):  # what is not finite is refused with the points
            out[part] = points[part].astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]
    return out


def _material_colour(prim, time) -> list[float] | None:
    """The colour that the surface shader of the bound material says, if it is one number each."""
    UsdShade = pxr("UsdShade")

    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    if not material:
        return None
    for context in ("", "arnold", "ri", "mtlx"):
        shader = material.ComputeSurfaceSource(context)[0]
        for name in COLOUR_INPUTS if shader else ():
            given = shader.GetInput(name)
            value = given.Get(time) if given and not given.HasConnectedSource() else None
            if value is not None and np.shape(value) == (3,):
                return [float(x) for x in value]
    return None


def write_result(path: str, file: BinaryIO, what: str = "curves") -> None:
    """Write what a stage has to an open file: .npz, with what is said as text in it."""
    try:
        said, arrays = extract(path, what)
    except MemoryError:
        raise
    except Exception as error:  # usd-core raises many kinds
        said, arrays = {"error": str(error)[:2000] or type(error).__name__}, {}
    arrays["said"] = np.frombuffer(json.dumps(said).encode(), np.uint8)
    # As np.savez writes them, but none is held once it is there.
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name in list(arrays):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, arrays.pop(name), allow_pickle=False)


def main(request: str) -> int:
    """Read what a request of furcl.groom.formats.usd names."""
    path, file, n_bytes, seconds, what = json.loads(request)
    for name in ("Usd", "UsdGeom", "UsdShade"):
        pxr(name)  # before its memory is limited

    limit_memory(n_bytes)
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    with os.fdopen(file, "wb") as shared:
        write_result(path, shared, what)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
