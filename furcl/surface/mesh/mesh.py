"""Meshes of a scene, and the buffers that kernels/include/surface/meshes.clh reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.device.layout import TRIANGLE, Fields, struct_dtype
from furcl.errors import MeshError
from furcl.surface.mesh.coat import COAT_HEAD, COAT_NODES, Coat
from furcl.surface.mesh.triangles import Triangles
from furcl.table import Triple

MATERIAL: Fields = (
    ("albedo", "float4"),
    ("emission", "float4"),
    ("texture", "uint"),  # word of the buffer where it begins; 0: none
    ("width", "uint"),
    ("height", "uint"),
    ("coat", "uint"),  # word of the buffer where its record begins; 0: none
    ("lamps", "uint"),  # of where it emits: number of a triangle's lamp less its own, modulo 2^32
    ("unused_x", "uint"),
    ("unused_y", "uint"),
    ("unused_z", "uint"),
)
# Words in front of the materials, the first of them where the records begin.
HEAD_WORDS = 16


@dataclass(frozen=True)
class MeshPart:
    """What kernels are built from: the part <meshes> of furcl.device.features.

    Attributes
    ----------
    normals : bool      whether a mesh is smooth
    textures : bool     whether a mesh has a texture
    emission : bool     whether a mesh emits light
    coat : bool         whether a mesh has a coat
    """

    normals: bool = True
    textures: bool = False
    emission: bool = False
    coat: bool = False

    name = "triangles"
    header = Path("surface/meshes.clh")

    def defines(self) -> dict[str, int | str]:
        """FURCL_MESH_*, and sizes of a coat's record."""
        return {
            "FURCL_MESH_NORMALS": int(self.normals),
            "FURCL_MESH_TEXTURES": int(self.textures),
            "FURCL_MESH_EMISSION": int(self.emission),
            "FURCL_MESH_COAT": int(self.coat),
            "FURCL_COAT_HEAD": COAT_HEAD,
            "FURCL_COAT_NODES": COAT_NODES,
        }

    def structs(self) -> dict[str, Fields]:
        """MeshMaterial."""
        return {"MeshMaterial": MATERIAL}

    def as_dict(self) -> dict[str, Any]:
        """Its fields."""
        return {
            "mesh_normals": self.normals,
            "mesh_textures": self.textures,
            "mesh_emission": self.emission,
            "mesh_coat": self.coat,
        }


#: With code for all that a mesh may have.
EVERY_MESH = MeshPart(normals=True, textures=True, emission=True, coat=True)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles and how they reflect.

    Attributes
    ----------
    triangles : Triangles
    albedo : (r, g, b)              0 to 1; a factor on the texture where there is one
    texture : (H, W, 3) or None     float32, 0 to 1; repeats
    emission : (r, g, b)            radiance of the fronts
    coat : Coat or None             over what reflects diffusely
    """

    triangles: Triangles
    albedo: Triple = (0.5, 0.5, 0.5)
    texture: NDArray[np.float32] | None = None
    emission: Triple = (0.0, 0.0, 0.0)
    coat: Coat | None = None

    @property
    def is_grey(self) -> bool:
        """Whether one channel tells all."""
        grey = len(set(self.albedo)) == 1 and len(set(self.emission)) == 1
        return grey and (
            self.texture is None or bool((self.texture == self.texture[:, :, :1]).all())
        )


class Meshes:
    """All meshes of a scene.

    Parameters
    ----------
    meshes : sequence of Mesh       at least one

    Raises
    ------
    MeshError       more triangles than a hit can name; a texture without places in it
    """

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self.meshes = tuple(meshes)
        if 3 * self.n_triangles >= TRIANGLE - 4:
            raise MeshError(
                f"the meshes have {self.n_triangles} triangles in all; up to {TRIANGLE // 3 - 1} "
                f"are possible; simplify them"
            )
        if any(m.texture is not None and m.triangles.places is None for m in self.meshes):
            raise MeshError(
                "a mesh has a texture and no texture coordinates; give it a file with them (vt in "
                "OBJ, s and t in PLY), or an albedo"
            )

    @property
    def n_triangles(self) -> int:
        """Of all meshes."""
        return sum(len(mesh.triangles) for mesh in self.meshes)

    @property
    def is_grey(self) -> bool:
        """Whether one channel tells all."""
        return all(mesh.is_grey for mesh in self.meshes)

    @property
    def part(self) -> MeshPart:
        """What the kernels need of them."""
        return MeshPart(
            normals=any(mesh.triangles.normals is not None for mesh in self.meshes),
            textures=any(mesh.texture is not None for mesh in self.meshes),
            emission=any(any(mesh.emission) for mesh in self.meshes),
            coat=any(mesh.coat is not None for mesh in self.meshes),
        )

    @property
    def lamps(self) -> list[Mesh]:
        """Those that emit light, each of whose triangles is a lamp."""
        return [mesh for mesh in self.meshes if any(mesh.emission)]

    def corners(self) -> NDArray[np.float32]:
        """Corners of the triangles of all meshes, (n, 3, 3)."""
        return np.concatenate([mesh.triangles.corners for mesh in self.meshes])

    def points(self) -> NDArray[np.float32]:
        """The corners as points (3 n, 3)."""
        return self.corners().reshape(-1, 3)

    def shading(self, part: MeshPart | None = None, first_lamp: int = 0) -> NDArray[np.float32]:
        """The buffer `shading` of kernels/include/surface/meshes.clh, for kernels with a part.

        `first_lamp` is the number of the lamp that the first triangle that emits light is.
        """
        part = part or self.part
        materials = np.zeros(len(self.meshes), struct_dtype(MATERIAL))
        records = np.concatenate(
            [_records(number, mesh.triangles, part) for number, mesh in enumerate(self.meshes)]
        )
        first_record = HEAD_WORDS + materials.nbytes // 4
        coats, textures = [], []
        at = -(-(first_record + records.size) // 4) * 4
        triangle, lamp = 0, first_lamp
        for material, mesh in zip(materials, self.meshes, strict=True):
            material["albedo"][:3] = mesh.albedo
            material["emission"][:3] = mesh.emission
            material["lamps"] = (lamp - triangle) & 0xFFFFFFFF
            triangle += len(mesh.triangles)
            lamp += len(mesh.triangles) if any(mesh.emission) else 0
            if mesh.coat is not None:
                material["coat"] = at
                coats.append(mesh.coat.record())
                at += coats[-1].size
        for material, mesh in zip(materials, self.meshes, strict=True):
            if mesh.texture is None:
                continue
            height, width, _ = mesh.texture.shape
            material["texture"], material["width"], material["height"] = at, width, height
            texels = np.zeros((height, width, 4), np.float16)
            texels[:, :, :3] = mesh.texture
            textures.append(texels.view(np.float32).ravel())
            at += textures[-1].size
        head = np.zeros(HEAD_WORDS, np.uint32)
        head[0] = first_record
        words = np.concatenate(
            [head.view(np.float32), materials.view(np.float32).ravel(), records.ravel()]
        )
        words = np.pad(words, (0, -len(words) % 4))
        return np.concatenate([words, *coats, *textures])


def _records(mesh: int, triangles: Triangles, part: MeshPart) -> NDArray[np.float32]:
    """The records of the triangles of a mesh, (n, words)."""
    n = len(triangles)
    columns = [np.full((n, 1), mesh, np.uint32).view(np.float32)]
    if part.normals:
        normals = triangles.normals
        if normals is None:
            a, b, c = np.moveaxis(triangles.corners.astype(np.float64), 1, 0)
            face = np.cross(b - a, c - a)
            face /= np.linalg.norm(face, axis=1, keepdims=True)
            normals = np.repeat(face[:, None], 3, axis=1).astype(np.float32)
        columns.append(normals.reshape(n, 9))
    if part.textures:
        places = triangles.places
        columns.append(np.zeros((n, 6), np.float32) if places is None else places.reshape(n, 6))
    return np.concatenate(columns, axis=1)
