"""What a USD stage has of meshes, by usd-core, in the process of furcl.groom.formats.usd_stage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

#: Names of texture coordinates, first those that most programs write.
_PLACES = ("st", "UVMap", "map1", "uv", "st0")


def extract_meshes(
    stage: Any, time: Any, said: dict[str, Any], arrays: dict[str, np.ndarray]
) -> None:
    """Puts what all visible meshes have into `said` and `arrays`, in world space.

    Polygons are as they are, of subdivision surfaces the cage.
    """
    from furcl.groom.formats.usd_stage import pxr

    UsdGeom = pxr("UsdGeom")
    transforms = UsdGeom.XformCache(time)
    for prim in visible_meshes(stage, time):
        matrix = np.array(transforms.GetLocalToWorldTransform(prim))
        said["meshes"].append(_mesh(prim, time, matrix, len(said["meshes"]), arrays, UsdGeom))


def visible_meshes(stage: Any, time: Any) -> Iterator[Any]:
    """The prims of a stage that are meshes and are rendered."""
    from furcl.groom.formats.usd_stage import pxr

    Usd, UsdGeom = pxr("Usd"), pxr("UsdGeom")
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            prims.PruneChildren()
            continue
        imageable = UsdGeom.Imageable(prim)
        if (
            prim.IsA(UsdGeom.Mesh)
            and imageable.ComputePurpose() in ("default", "render")
            and imageable.ComputeVisibility(time) != "invisible"
        ):
            yield prim


def _mesh(prim, time, matrix, number, arrays, UsdGeom) -> dict[str, Any]:
    mesh = UsdGeom.Mesh(prim)

    def keep(name, value, dtype):
        arrays[f"{number}/{name}"] = np.asarray([] if value is None else value, dtype)

    with np.errstate(all="ignore"):  # what is not finite is refused with the vertices
        points = np.asarray(mesh.GetPointsAttr().Get(time) or [], np.float64).reshape(-1, 3)
        keep("points", points @ matrix[:3, :3] + matrix[3, :3], np.float64)
        determinant = float(np.linalg.det(matrix[:3, :3]))
        kept = {"path": str(prim.GetPath()), "normals": None, "places": None}
        normals = mesh.GetNormalsAttr().Get(time)
        primvars = UsdGeom.PrimvarsAPI(prim)
        of_normals = str(mesh.GetNormalsInterpolation())
        primvar = primvars.GetPrimvar("normals")  # has precedence
        if primvar and primvar.HasValue():
            normals, of_normals = primvar.ComputeFlattened(time), str(primvar.GetInterpolation())
        if normals is not None and determinant != 0.0 and np.isfinite(determinant):
            world = np.asarray(normals, np.float64).reshape(-1, 3) @ np.linalg.inv(matrix[:3, :3]).T
            length = np.linalg.norm(world, axis=1, keepdims=True)
            keep("normals", world / np.where(length > 0.0, length, 1.0), np.float64)
            kept["normals"] = of_normals
    numbers = {
        "counts": mesh.GetFaceVertexCountsAttr(),
        "indices": mesh.GetFaceVertexIndicesAttr(),
        "holes": mesh.GetHoleIndicesAttr(),
    }
    for name, attribute in numbers.items():
        value = attribute.Get(time)
        # A stage may say another type than the schema's: one number, or several in a row.
        keep(name, None if value is None else np.reshape(value, -1), np.int64)
    for name in _PLACES:
        primvar = primvars.GetPrimvar(name)
        value = primvar.ComputeFlattened(time) if primvar and primvar.HasValue() else None
        if value is not None and np.ndim(value) == 2 and np.shape(value)[1] == 2:
            keep("places", value, np.float64)
            kept["places"] = str(primvar.GetInterpolation())
            break
    left = str(mesh.GetOrientationAttr().Get(time)) == "leftHanded"
    return {**kept, "turned": left != (determinant < 0.0)}
