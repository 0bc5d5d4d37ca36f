"""The tables of grooms in scenes: a file, and one for each generator of `furcl.groom.grow`.

Those of generators are made from their signatures and ranges.
"""

from __future__ import annotations

import inspect
import logging
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from furcl.errors import GroomError
from furcl.groom import grow
from furcl.groom.curves import ADVICE, Curves
from furcl.surface.mesh.read import read_mesh
from furcl.surface.mesh.triangles import Triangles
from furcl.table import Length, Table

log = logging.getLogger(__name__)


class CurvesTable(Table, frozen=True, kw_only=True, tag_field="generator"):
    """Base of the tables of grooms; a subclass says its generator as `tag`."""

    def build(self) -> Curves:
        """Read or grow the groom.

        Raises
        ------
        GroomError      if the file cannot be used, or the generator refuses its parameters
        """
        raise NotImplementedError


class FileCurves(CurvesTable, frozen=True, kw_only=True, tag="file"):
    """A groom file of one of the formats of docs/formats.md.

    Attributes
    ----------
    file : str                  the file
    radius_scale : float        factor on all radii
    default_radius : float      radius where the file has none, or only 0; without it such a file is
                                refused [unit]
    default_radius_share : float    where the file has no radius and default_radius is left out: the
                                radius, of the largest side of the box around the groom
    up_axis : str               axis of the file that is up; "y" turns a groom to stand along +z,
                                facing -y if it faced +z; what the file says if left out, and "z"
                                where it says none
    basis : str                 what the points are where the file does not say: corners of
                                polylines, or control points of cubic curves
    points_per_strand : int     where the file does not say where strands begin
    """

    file: Annotated[str, Meta(examples=["groom.hair"])]
    radius_scale: Annotated[float, Meta(gt=0.0, le=1e9)] = 1.0
    default_radius: Length | None = None
    default_radius_share: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None
    up_axis: Literal["x", "y", "z"] | None = None
    basis: Literal["linear", "bezier", "bspline", "catmull-rom"] = "linear"
    points_per_strand: Annotated[int, Meta(ge=2, le=65536)] | None = None

    def build(self) -> Curves:
        from furcl.groom.orient import z_up

        return z_up(self.read(), self.up_axis)

    def read(self) -> Curves:
        """The groom in the axes of its file.

        Raises
        ------
        GroomError      if the file cannot be used
        """
        try:
            return self._read(self.default_radius)
        except GroomError as error:
            share = self.default_radius_share
            if ADVICE not in str(error) or share is None or self.default_radius is not None:
                raise
            points = self._read(1.0).points
            radius = share * float((points.max(axis=0) - points.min(axis=0)).max())
            if not 0.0 < radius < float("inf"):
                raise
            log.warning(
                "%s: has no radii; strands are given one of %.4g, %g of the groom's size "
                "(curves.default_radius says another)",
                self.file,
                radius,
                share,
            )
            return self._read(radius)

    def _read(self, default_radius: float | None) -> Curves:
        from furcl.groom.formats import load_curves

        return load_curves(
            self.file,
            default_radius,
            self.radius_scale,
            basis=self.basis,
            points_per_strand=self.points_per_strand,
        )


class InterpolatedCurves(FileCurves, frozen=True, kw_only=True, tag="interpolate"):
    """Children of the guide strands in a file: hair or fur between them, or on a mesh near them.

    Attributes
    ----------
    file : str                  the guides
    radius_scale : float        factor on all radii
    default_radius : float      radius where the file has none, or only 0 [unit]
    default_radius_share : float    as of a file of strands
    up_axis : str               axis of the file that is up, as of a file of strands
    basis : str                 as of a file of strands
    points_per_strand : int     as of a file of strands
    mesh_file : str             .obj or .ply on which the children's roots are, spread evenly where
                                guides are near; in the space of the guides' file. Left out, they
                                are between those of the guides
    root_reach : float          how far from a guide's root roots may be on the mesh; left out,
                                twice the median distance of guides from the next one [unit]
    n_strands : int             children
    n_points : int              points a child; as many as guides have at most if left out
    seed : int                  of the random numbers
    clumping : float            pull towards the child's own guide at the tip
    spread_deg : float          guides that go elsewhere, by so much between root and tip, give a
                                child nothing: a parting stays one [deg]
    length_variation : float    v: children are cut to a length uniform in [1 - v, 1] of what their
                                guides make
    frizz : float               wander at the tip, of the guide's length
    radius : float              at the root; that of the guides if left out [unit]
    radius_variation : float    v: relative, uniform in [1 - v, 1 + v]
    """

    mesh_file: str | None = None
    root_reach: Length | None = None
    n_strands: Annotated[int, Meta(ge=1, le=50_000_000)] = 100_000
    n_points: Annotated[int, Meta(ge=2, le=4096)] | None = None
    seed: Annotated[int, Meta(ge=0, le=(1 << 63) - 1)] = 1
    clumping: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    spread_deg: Annotated[float, Meta(ge=0.0, le=180.0)] = 60.0
    length_variation: Annotated[float, Meta(ge=0.0, le=0.95)] = 0.1
    frizz: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    radius: Length | None = None
    radius_variation: Annotated[float, Meta(ge=0.0, le=0.9)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.root_reach is not None and self.mesh_file is None:
            raise ValueError(
                f"root_reach = {self.root_reach}: roots are on no mesh; give mesh_file, or leave "
                f"it out"
            )

    def build(self) -> Curves:
        from furcl.groom.grow.interpolate import children
        from furcl.groom.orient import axis_up, z_up

        read = self.read()
        guides, axis = z_up(read, self.up_axis), axis_up(read, self.up_axis)
        if guides.times:
            raise GroomError(
                f"{self.file}: guides that move have no children yet; write the guides of one time "
                f"step, or the children of all of them."
            )
        not_own = {*FileCurves.__struct_fields__, "mesh_file", "root_reach"}
        own = set(self.__struct_fields__) - not_own
        return children(
            guides,
            **{name: getattr(self, name) for name in own},
            roots=None if self.mesh_file is None else self._roots(self.mesh_file, guides, axis),
            source=self.file,
        )

    def _roots(self, mesh_file: str, guides: Curves, axis: str) -> NDArray[np.float64]:
        """Roots (n_strands, 3) on the mesh, whose `axis` is up.

        Raises
        ------
        MeshError, GroomError       a mesh that cannot be used, or that guides are not on
        """
        from furcl.groom.grow.mesh_roots import roots_near, usual_reach
        from furcl.groom.orient import turned

        mesh = read_mesh(mesh_file)
        vertices = turned(mesh.vertices, axis)
        triangles = Triangles.from_arrays(vertices, mesh.faces, smooth=False, where=mesh_file)
        of_guides = guides.points[guides.offsets[:-1]].astype(np.float64)
        reach = self.root_reach or usual_reach(of_guides)
        if not reach > 0.0:
            raise GroomError(
                f"{self.file}: {guides.n_strands} guides say not how far around them roots are; "
                f"give curves.root_reach"
            )
        # Numbers of their own: as many roots as strands change none of the strands.
        rng = np.random.default_rng([self.seed, 2])
        corners = triangles.corners.astype(np.float64)
        return roots_near(corners, of_guides, self.n_strands, reach, rng, mesh_file)


class _Grown(CurvesTable, frozen=True, kw_only=True):
    """A groom of a generator of furcl's; its fields are the generator's parameters."""

    def build(self) -> Curves:
        generator = grow.GENERATORS[str(self.__struct_config__.tag)]
        return generator(**{name: getattr(self, name) for name in self.__struct_fields__})


def _field_type(allowed: tuple[Any, ...], default: Any) -> Any:
    """The type of a parameter: a choice of words, or whole or real numbers within a range."""
    if isinstance(allowed[0], str):
        kind: Any = Literal[*allowed]
    else:
        number = int if isinstance(allowed[0], int) else float
        kind = Annotated[number, Meta(ge=allowed[0], le=allowed[1])]
    if isinstance(default, tuple):
        kind = tuple[*[kind] * len(default)]
    return kind | None if default is None else kind


def _grown(generator: str) -> Any:
    parameters = inspect.signature(grow.GENERATORS[generator]).parameters
    ranges = grow.RANGES[generator]
    fields = [
        (name, _field_type(ranges[name], parameter.default), parameter.default)
        for name, parameter in parameters.items()
    ]
    table = msgspec.defstruct(
        f"{generator.capitalize()}Curves",
        fields,
        bases=(_Grown,),
        frozen=True,
        kw_only=True,
        tag=generator,
        module=__name__,
        namespace={"__doc__": grow.GENERATORS[generator].__doc__},
    )
    globals()[table.__name__] = table  # where pickle looks for it
    return table


BUILT_IN: dict[str, type[CurvesTable]] = {
    "file": FileCurves,
    "interpolate": InterpolatedCurves,
    **{generator: _grown(generator) for generator in grow.GENERATORS},
}
