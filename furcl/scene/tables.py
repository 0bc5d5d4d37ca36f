"""The tables of a scene file, with the range of every value in its type.

Angles are in degrees (`_deg`), lengths in world units, absorption per fibre radius, radiance linear
with Rec.709 primaries. Unknown keys are refused; `furcl.scene.read` reads files and words the
messages.
"""

from __future__ import annotations

import dataclasses
import functools
import operator
from typing import TYPE_CHECKING, Annotated, Literal, cast

import msgspec
import numpy as np
from msgspec import Meta

from furcl.fibre import samplers
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.table import FibreTable
from furcl.groom.generators import FibreCurves, FurCurves, HairCurves, build_generated
from furcl.light import kinds as lights
from furcl.scene.camera import Camera
from furcl.surface.ellipsoid import Body
from furcl.table import Length, Table

if TYPE_CHECKING:
    from furcl.groom.curves import Curves
    from furcl.light.model import Light

    EnvironmentTable = Table
else:
    EnvironmentTable = functools.reduce(operator.or_, [light.table for light in lights.BUILT_IN])

FILTER_SUPPORT_PX = {"box": 0.5, "tent": 1.0, "gaussian": 1.5}


class Film(Table, frozen=True, kw_only=True):
    """Picture size and pixel filter.

    The filters are products of two 1-D ones with the stated half width: box; tent; gaussian with
    standard deviation filter_radius_px / 3, cut at the half width. `exposure_stops` acts on PNG
    files only.
    """

    width: Annotated[int, Meta(ge=1, le=16384)] = 512
    height: Annotated[int, Meta(ge=1, le=16384)] = 512
    filter: Literal["gaussian", "tent", "box"] = "gaussian"
    filter_radius_px: Annotated[float, Meta(ge=0.5, le=4.0)] | None = None
    exposure_stops: Annotated[float, Meta(ge=-30.0, le=30.0)] = 0.0

    @property
    def support_px(self) -> float:
        """Half width of the filter [pixels]: filter_radius_px, or box 0.5, tent 1, gaussian 1.5."""
        if self.filter_radius_px is not None:
            return self.filter_radius_px
        return FILTER_SUPPORT_PX[self.filter]

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.width / self.height


class FileCurves(Table, frozen=True, kw_only=True, tag_field="generator", tag="file"):
    """A groom file.

    Radii are multiplied by `radius_scale`; `default_radius` stands in where the file has none.
    `up_axis` = "y" turns a groom whose +y is up to stand along +z, facing -y if it faced +z.
    """

    file: str
    radius_scale: Annotated[float, Meta(gt=0.0, le=1e9)] = 1.0
    default_radius: Length | None = None
    up_axis: Literal["y", "z"] = "z"


class Render(Table, frozen=True, kw_only=True):
    """Samples and samplers.

    `light_sampling`: "bcsdf" samples fibres only, "mis" also the environment, "auto" chooses by the
    environment. Paths end at `max_depth`; from `roulette_depth` on they may end at random without
    bias. `residual` adds the light of two and more internal reflections, so that white fibres
    conserve energy.
    """

    spp: Annotated[int, Meta(ge=1, le=1 << 20)] = 64
    seed: Annotated[int, Meta(ge=0, le=(1 << 32) - 1)] = 0
    max_depth: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    sampling: str = "full-cdf"
    light_sampling: Literal["auto", "bcsdf", "mis"] = "auto"
    roulette_depth: Annotated[int, Meta(ge=0, le=100_000)] = 8
    residual: bool = False
    variance: bool = True
    statistics: bool = True

    def __post_init__(self) -> None:
        samplers.find(self.sampling)


class Scene(Table, frozen=True, kw_only=True):
    """A whole scene. File names in it are absolute once `furcl.load_scene` has read it."""

    name: str = ""
    camera: Camera = Camera()
    film: Film = Film()
    fibre: FibreTable
    environment: EnvironmentTable
    curves: FileCurves | HairCurves | FurCurves | FibreCurves
    body: Body | None = None
    render: Render = Render()

    def build_fibre(self) -> Fibre:
        """The fibre of the scene; raises FibreError on values outside their ranges."""
        return self.fibre.build()

    def build_light(self) -> Light:
        """The light of the scene; images are read here.

        Raises
        ------
        ImageError      if the image cannot be used
        """
        return lights.from_table(self.environment)

    def build_curves(self) -> Curves:
        """Read or grow the groom.

        Raises
        ------
        GroomError      if the file cannot be used, or the generator refuses its parameters
        """
        table = self.curves
        if not isinstance(table, FileCurves):
            return build_generated(table)
        from furcl.groom.formats import load_curves

        curves = load_curves(table.file, table.default_radius, table.radius_scale)
        if table.up_axis == "z":
            return curves
        points = curves.points[:, [0, 2, 1]]
        points[:, 1] *= -1.0
        points.flags.writeable = False
        return dataclasses.replace(curves, points=points)

    def resolved_camera(self, curves: Curves) -> Camera:
        """The camera with all places filled in; if it frames, it frames groom and body."""
        points, radius = curves.points, float(curves.radii.max())
        if self.body is not None and self.camera.origin is None:
            points = self.camera.outermost(points, self.film.aspect)
            points = np.concatenate([points, self.body.points()])
        return self.camera.resolved(points, self.film.aspect, radius)


def scene_type() -> type[Scene]:
    """The type to decode scenes with: Scene, its environment of any kind that is known by now."""
    return _scene_type(tuple(lights.tables().values()))


@functools.lru_cache(maxsize=4)
def _scene_type(environments: tuple[type[Table], ...]) -> type[Scene]:
    if environments == tuple(light.table for light in lights.BUILT_IN):
        return Scene
    environment = functools.reduce(operator.or_, environments)
    extended = msgspec.defstruct(
        "Scene", [("environment", environment)], bases=(Scene,), frozen=True, kw_only=True
    )
    return cast("type[Scene]", extended)
