"""Tables of meshes in a scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from furcl.errors import MeshError
from furcl.groom.formats.usd_mesh import read_mesh
from furcl.scene.transform import Transform
from furcl.surface.mesh.coat import ETA_RANGE, ROUGHNESS_RANGE, Coat
from furcl.surface.mesh.mesh import Mesh
from furcl.surface.mesh.texture import read_texture
from furcl.surface.mesh.triangles import BLOCK, Triangles
from furcl.table import Rgb, Table, check_range, triple

#: What a mesh without a texture reflects where nothing is said.
ALBEDO = 0.5


class CoatTable(Table, frozen=True, kw_only=True):
    """A clear coat over a mesh, such as the oil and the outer layer of skin: one rough boundary.

    What it does not reflect, the base under it does: a white base under any coat is white.

    Attributes
    ----------
    eta : float             its index of refraction over that outside
    roughness : float       its square is the alpha of GGX
    """

    eta: Annotated[float, Meta(ge=ETA_RANGE[0], le=ETA_RANGE[1])] = Coat.eta
    roughness: Annotated[float, Meta(ge=ROUGHNESS_RANGE[0], le=ROUGHNESS_RANGE[1])] = Coat.roughness

    def build(self) -> Coat:
        """The coat."""
        return Coat(self.eta, self.roughness)


class MeshTable(Table, frozen=True, kw_only=True):
    """A mesh of triangles, OBJ, PLY or USD: diffuse on both sides, under a coat if it has one.

    Attributes
    ----------
    file : str                  the mesh, .obj or .ply, or .usd, .usda, .usdc: all meshes of
                                the stage, turned to stand along z as it says what is up
    transform : table           where it stands
    smooth : bool               reflect by normals between those of the corners, which are the
                                file's or means of those of the triangles around; false shows
                                facets
    albedo : (r,g,b)            what it reflects, 0.5 if left out; with a texture a factor on that,
                                1 if left out
    texture_file : str          picture of what it reflects, .exr, .png or .jpg, placed by the
                                file's texture coordinates and repeated
    emission : (r,g,b)          radiance that it emits outwards
    coat : table                a clear coat over it, for skin
    """

    file: Annotated[str, Meta(examples=["head.obj"])]
    transform: Transform = Transform()
    smooth: bool = True
    albedo: Rgb | None = None
    texture_file: str | None = None
    emission: Rgb = 0.0
    coat: CoatTable | None = None

    def __post_init__(self) -> None:
        if self.albedo is not None:
            check_range("albedo", self.albedo, 0.0, 1.0)
        check_range("emission", self.emission, 0.0, 1e9)

    def build(self, where: str = "mesh") -> Mesh:
        """Read the mesh and its texture.

        Raises
        ------
        MeshError, ImageError       if a file cannot be used
        """
        found = read_mesh(self.file)
        where = f"{where}, {self.file}"
        if self.texture_file is not None and found.places is None:
            raise MeshError(
                f"{where}: has no texture coordinates, which {self.texture_file} needs; "
                f"export it with them (vt in OBJ, s and t in PLY), or give an albedo instead"
            )
        mirrored = np.linalg.det(self.transform.as_matrix()[:3, :3]) < 0.0
        order = np.s_[:, ::-1] if mirrored else np.s_[:]
        arrays: dict[str, Any] = {
            "vertices": _in_blocks(self.transform.points, found.vertices),
            "faces": found.faces[order],
        }
        if self.smooth and found.normals is not None:
            index = found.faces if found.normal_faces is None else found.normal_faces
            arrays |= {
                "normals": _in_blocks(self._turned, found.normals),
                "normal_faces": index[order],
            }
        if self.texture_file is not None:
            index = found.faces if found.place_faces is None else found.place_faces
            arrays |= {"places": found.places, "place_faces": index[order]}
        del found  # a copy of a large mesh
        triangles = Triangles.from_arrays(**arrays, smooth=self.smooth, where=where)
        texture = None if self.texture_file is None else read_texture(self.texture_file)
        albedo = self.albedo
        if albedo is None:
            albedo = ALBEDO if texture is None else 1.0
        coat = None if self.coat is None else self.coat.build()
        return Mesh(triangles, triple(albedo), texture, triple(self.emission), coat)

    def _turned(self, normals: NDArray[Any]) -> NDArray[np.float64]:
        """Normals of the file in the scene; those without a length stay so."""
        out = np.zeros(normals.shape)
        has_length = (normals != 0.0).any(axis=1)
        out[has_length] = self.transform.normals(normals[has_length])
        return out


def _in_blocks(
    change: Callable[[NDArray[Any]], NDArray[np.float64]], rows: NDArray[Any]
) -> NDArray[np.float32]:
    """Rows that are changed in float64, without a copy of all of them in it."""
    out = np.empty(rows.shape, np.float32)
    with np.errstate(all="ignore"):  # what is too large or no number is refused later
        for start in range(0, len(rows), BLOCK):
            out[start : start + BLOCK] = change(rows[start : start + BLOCK])
    return out
