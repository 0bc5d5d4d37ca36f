"""The tables of a scene file, with the range of every value in its type.

Angles are in degrees (`_deg`), lengths in world units, absorption per fibre radius, radiance linear
with Rec.709 primaries. Unknown keys are refused; `furcl.scene.read` reads files and words the
messages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from furcl.device.layout import LAYERS, Filter, Layer, Sequence
from furcl.errors import SceneError
from furcl.fibre import model as models
from furcl.fibre import samplers
from furcl.fibre.model import ModelTable
from furcl.groom import kinds as groom_kinds
from furcl.groom.curves import Curves
from furcl.groom.joined import Groom as GroomCurves
from furcl.groom.joined import Grooms
from furcl.groom.tables import CurvesTable
from furcl.image.size import Window
from furcl.light import kinds as lights
from furcl.light.lights import Lights
from furcl.light.model import Light
from furcl.scene import lamps
from furcl.scene.camera import Camera
from furcl.scene.groom import Groom
from furcl.scene.lamps import Lamp
from furcl.scene.mesh import MeshTable
from furcl.surface import kinds as surfaces
from furcl.surface.mesh.mesh import Meshes
from furcl.surface.model import Surface
from furcl.table import Table, triple

Keys = tuple[str, ...]
"""What leads to a value of a scene document, from the outermost table in."""

FILTER_SUPPORT_PX: dict[Filter, float] = {"box": 0.5, "tent": 1.0, "gaussian": 1.5}

MOST_SPP = 1 << 20


Pixel = Annotated[int, Meta(ge=0, le=16384)]


class Film(Table, frozen=True, kw_only=True):
    """Picture size and pixel filter.

    Attributes
    ----------
    width : int                 of the picture [pixels]
    height : int                of the picture [pixels]
    filter : str                product of two 1-D filters; a gaussian has the standard deviation
                                filter_radius_px / 3 and is cut at the half width
    filter_radius_px : float    half width of the filter; box 0.5, tent 1, gaussian 1.5 if left out
                                [pixels]
    exposure_stops : float      brightness of PNG files [stops]
    crop : 4 whole numbers      left, top, right, bottom of the window that is rendered, counted
                                from the top left; right and bottom are the first that are not
                                [pixels]
    camera : str                name of the camera that sees it, of a scene with several; the first
                                if left out
    background : str            what is seen where a camera ray meets nothing: the "light" of its
                                direction, or nothing, "transparent", with an alpha
    layers : list of words      what is written beside the picture (docs/layers.md)
    """

    width: Annotated[int, Meta(ge=1, le=16384)] = 512
    height: Annotated[int, Meta(ge=1, le=16384)] = 512
    filter: Filter = "gaussian"
    filter_radius_px: Annotated[float, Meta(ge=0.5, le=4.0)] | None = None
    exposure_stops: Annotated[float, Meta(ge=-30.0, le=30.0)] = 0.0
    crop: tuple[Pixel, Pixel, Pixel, Pixel] | None = None
    camera: str | None = None
    background: Literal["light", "transparent"] = "light"
    layers: tuple[Layer, ...] = ()

    def __post_init__(self) -> None:
        twice = [name for name in LAYERS if self.layers.count(name) > 1]
        if twice:
            raise ValueError(f"layers = {list(self.layers)} has {twice[0]!r} twice; remove one")
        if self.crop is None:
            return
        left, top, right, bottom = self.crop
        if not (left < right <= self.width and top < bottom <= self.height):
            raise ValueError(
                f"crop = {list(self.crop)} holds no pixels of a picture of {self.width} x "
                f"{self.height}; give left < right <= {self.width} and top < bottom <= "
                f"{self.height}"
            )

    @property
    def window(self) -> Window:
        """What is rendered of the picture."""
        left, top, right, bottom = self.crop or (0, 0, self.width, self.height)
        return Window(left, top, right - left, bottom - top, self.width, self.height)

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


class Render(Table, frozen=True, kw_only=True):
    """Samples and samplers.

    Attributes
    ----------
    spp : int               samples a pixel, on average where allocation is "adaptive"
    seed : int              of the random numbers
    max_depth : int         longest path [bounces]
    sampling : str          how lobe, offset and direction are sampled, or the name of a sampler of
                            your own (docs/own_sampler.md)
    light_sampling : str    "bcsdf" samples fibres only, "mis" also the light, "auto" chooses by the
                            light
    lamp_choice : str       how light samples take one of many lamps: by the light that it may send
                            to the "position", or by its "power" alone
    allocation : str        "even" gives every pixel the same number of samples, "adaptive" more to
                            those with larger errors
    sequence : str          random numbers of a pixel's samples: "independent", or "sobol", spread
                            evenly, for less noise; the variance that the film keeps is then an
                            upper bound
    roulette : str          when paths may end at random, without bias: "depth" from a depth on with
                            their throughput as the chance to go on, "throughput" from the first
                            bounce with their throughput over a threshold, "adjoint" with one
                            that is learned in the first samples from what rays brought, for light
                            samples too
    roulette_depth : int    from here on paths may end at random; with roulette = "depth" 8 if left
                            out, else 0 [bounces]
    roulette_threshold : float  a path goes on with its throughput over this as its chance; with
                            roulette = "depth" 1 if left out, else 0.3; with "adjoint" that
                            is until something is learned
    shadow_threshold : float    light samples are tested with what they bring to the picture over
                            this as their chance, without bias; 0 tests all; with roulette =
                            "adjoint" that is until something is learned [radiance]
    residual : bool         add the light of two and more reflections inside a fibre, so that white
                            fibres conserve energy
    variance : bool         keep the variance of every pixel
    statistics : bool       count lobes and path lengths
    """

    allowed: ClassVar = {"sampling": samplers.BUILT_IN}

    spp: Annotated[int, Meta(ge=1, le=MOST_SPP)] = 64
    seed: Annotated[int, Meta(ge=0, le=(1 << 32) - 1)] = 0
    max_depth: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    sampling: str = "full-cdf"
    light_sampling: Literal["auto", "bcsdf", "mis"] = "auto"
    lamp_choice: Literal["position", "power"] = "position"
    allocation: Literal["even", "adaptive"] = "even"
    sequence: Sequence = "sobol"
    roulette: Literal["depth", "throughput", "adjoint"] = "adjoint"
    roulette_depth: Annotated[int, Meta(ge=0, le=100_000)] | None = None
    roulette_threshold: Annotated[float, Meta(ge=1e-6, le=1e6)] | None = None
    shadow_threshold: Annotated[float, Meta(ge=0.0, le=1e9)] = 0.0
    residual: bool = False
    variance: bool = True
    statistics: bool = True

    def __post_init__(self) -> None:
        samplers.find(self.sampling)

    @property
    def first_roulette(self) -> int:
        """The depth from which paths may end at random [bounces]."""
        if self.roulette_depth is not None:
            return self.roulette_depth
        return 8 if self.roulette == "depth" else 0

    @property
    def survival_threshold(self) -> float:
        """The throughput below which they may."""
        if self.roulette_threshold is not None:
            return self.roulette_threshold
        return 1.0 if self.roulette == "depth" else 0.3


@dataclass(frozen=True)
class Kinds:
    """What a table of the scene may be, told apart by one of its keys.

    Attributes
    ----------
    tag : str               that key
    tables : callable       its values and the types of their tables, asked for at every reading, so
                            that what was registered since then is known
    default : str or None   value of the key where it is left out; None: it must be given
    """

    tag: str
    tables: Callable[[], Mapping[str, type[Table]]]
    default: str | None = None

    def name_in(self, table: object) -> Any:
        """What the values of a table say that it is; None if nothing."""
        return table.get(self.tag, self.default) if isinstance(table, dict) else None

    def type_of(self, table: object) -> type[Table] | None:
        """The type of the table with these values; None if they say nothing that is known."""
        name = self.name_in(table)
        return self.tables().get(name) if isinstance(name, str) else None


# By the last of the keys that lead to such a table.
KINDS = {
    "fibre": Kinds("model", models.tables, "double-cylinder"),
    "environment": Kinds("kind", lights.tables),
    "lamp": Kinds("kind", lamps.tables),
    "curves": Kinds("generator", groom_kinds.tables, "file"),
    "body": Kinds("kind", surfaces.tables, "ellipsoid"),
}
# Keys whose tables are named by the scene -> the table of the scene that each of them is like.
NAMED = {
    "groom": None,
    "material": "fibre",
    "lamp": "lamp",
    "mesh": None,
    "cameras": "camera",
}


def kinds_at(keys: Keys) -> Kinds | None:
    """What the table that keys lead to may be; None if it has no kinds."""
    if len(keys) == 1 and keys[0] not in NAMED:
        return KINDS.get(keys[0])
    if len(keys) == 2 and NAMED.get(keys[0]):
        return KINDS.get(str(NAMED[keys[0]]))
    if len(keys) == 3 and keys[0] in NAMED:
        return KINDS.get(keys[2])
    return None


class Scene(Table, frozen=True, kw_only=True):
    """A whole scene. File names in it are absolute once `furcl.load_scene` has read it.

    Attributes
    ----------
    name : str              of the scene; the file's name if left out
    camera, film, fibre, environment, curves, body, render : tables
    groom, material, lamp, mesh, cameras : dict     name -> table
    """

    name: str = ""
    camera: Camera = Camera()
    film: Film = Film()
    fibre: ModelTable | None = None
    environment: Table | None = None
    lamp: dict[str, Lamp] = msgspec.field(default_factory=dict)
    curves: CurvesTable | None = None
    groom: dict[str, Groom] = msgspec.field(default_factory=dict)
    material: dict[str, ModelTable] = msgspec.field(default_factory=dict)
    cameras: dict[str, Camera] = msgspec.field(default_factory=dict)
    body: Surface | None = None
    mesh: dict[str, MeshTable] = msgspec.field(default_factory=dict)
    render: Render = Render()

    def __repr__(self) -> str:
        ones = [getattr(self, name) for name in KINDS if name not in NAMED]
        kinds = [str(table.__struct_config__.tag) for table in ones if table is not None]
        several = ("groom", "lamp", "mesh")
        kinds += [f"{key} {name}" for key in several for name in getattr(self, key)]
        return f"Scene({self.name!r}, {self.film.width} x {self.film.height}, {', '.join(kinds)})"

    def __hash__(self) -> int:
        values = (getattr(self, name) for name in self.__struct_fields__)
        return hash(tuple(tuple(v.items()) if isinstance(v, dict) else v for v in values))

    def grooms(self) -> dict[str, Groom]:
        """The grooms by name, each with its fibre; the short form, [curves], is one named
        "groom"."""
        if self.curves is not None:
            return {"groom": Groom(curves=self.curves, fibre=self.fibre)}
        return {name: self._with_fibre(groom) for name, groom in self.groom.items()}

    def _with_fibre(self, groom: Groom) -> Groom:
        found = self.fibre if groom.material is None else self.material[groom.material]
        return msgspec.structs.replace(groom, material=None, fibre=groom.fibre or found)

    def materials(self) -> dict[str, ModelTable]:
        """The fibre materials that grooms are of, by name: [material.NAME], [groom.NAME.fibre]
        by the groom's name, and [fibre] as "fibre"."""
        found = {}
        for name, groom in self.grooms().items():
            assert groom.fibre is not None  # by the check of every scene that is read
            found[self.material_name(name)] = groom.fibre
        return found

    def material_name(self, groom: str) -> str:
        """The name in `materials` of what a groom of that name is of."""
        table = self.groom.get(groom)
        if table is None or (table.material is None and table.fibre is None):
            return "fibre"
        return table.material or f"groom {groom}"

    def build_fibres(self) -> dict[str, Any]:
        """Name of each fibre material -> its parameters, of its model's own class.

        Raises
        ------
        FibreError      a value outside its range
        """
        return {name: table.build() for name, table in self.materials().items()}

    def build_fibre(self) -> Any:
        """The parameters of the only fibre.

        Raises
        ------
        FibreError      a value outside its range
        SceneError      several fibre materials
        """
        fibres = self.build_fibres()
        if len(fibres) > 1:
            raise SceneError(
                f"scene {self.name!r}: {len(fibres)} materials, {', '.join(fibres)}; one is taken "
                f"here"
            )
        return next(iter(fibres.values()))

    def build_light(self) -> Light:
        """The environment; files are read here.

        Raises
        ------
        ImageError      if the image of the light cannot be used
        SceneError      if the scene has lamps alone
        """
        if self.environment is None:
            raise SceneError(
                f"scene {self.name!r} has no [environment]; build_lights() gives its lamps"
            )
        return lights.from_table(self.environment)

    def build_lights(self, meshes: Meshes | None = None) -> Lights:
        """The environment and the lamps; files are read here.

        Parameters
        ----------
        meshes : Meshes or None     those of `build_meshes`, if light samples are to find those of
                                    them that emit light

        Raises
        ------
        ImageError      if the image of the light cannot be used
        LightError      if a lamp cannot be used
        """
        environment = None if self.environment is None else self.build_light()
        by_position = self.render.lamp_choice == "position"
        return Lights(environment, lamps.build(self.lamp, by_position, meshes))

    @property
    def has_bright_meshes(self) -> bool:
        """Whether meshes emit light."""
        return any(any(triple(table.emission)) for table in self.mesh.values())

    def placed_lamps(self) -> list[str]:
        """Keys of the lamps that have a place, in the order of `Lights`."""
        placed = (item for item in self.lamp.items() if item[1].__struct_config__.tag != "distant")
        return [f"lamp.{name}" for name, table in placed for _ in table.records()]

    def build_grooms(self) -> Grooms:
        """Read or grow the grooms and put them in their places, those that move with time steps
        while the shutter of the chosen camera is open.

        Raises
        ------
        GroomError      if a file cannot be used, a generator refuses its parameters, or the shutter
                        is open at other times than a groom knows
        SceneError      a transform that radii cannot follow
        """
        numbers = {name: number for number, name in enumerate(self.materials())}
        span = self.chosen_camera.shutter
        return Grooms(
            [
                GroomCurves(name, table.build(name, span), numbers[self.material_name(name)])
                for name, table in self.grooms().items()
            ]
        ).during(span)

    def build_curves(self) -> Curves:
        """The strands of all grooms, see `build_grooms`."""
        return self.build_grooms().curves

    def build_meshes(self) -> Meshes | None:
        """The meshes with their textures, read from their files; None where there are none.

        Raises
        ------
        MeshError, ImageError       if a file cannot be used
        """
        if not self.mesh:
            return None
        return Meshes([table.build(f"mesh.{name}") for name, table in self.mesh.items()])

    def resolved_camera(self, curves: Curves, meshes: Meshes | None = None) -> Camera:
        """The camera with all places filled in; if it frames, it frames groom, body and meshes."""
        points, radius = curves.points, float(curves.radii.max())
        if self.chosen_camera.origin is None:
            others = self._framed_beside(meshes)
            if others:
                outermost, aspect = self.chosen_camera.outermost, self.film.aspect
                points = np.concatenate([outermost(p, aspect) for p in (points, *others)])
        return self.chosen_camera.resolved(points, self.film.aspect, radius)

    def _framed_beside(self, meshes: Meshes | None) -> list[NDArray[np.float32]]:
        """Points (n, 3) of body and meshes."""
        body = [] if self.body is None else [self.body.points().astype(np.float32)]
        return body + ([] if meshes is None else [meshes.points()])

    @property
    def chosen_camera(self) -> Camera:
        """Of several cameras that which `film.camera` names, or the first; else the only one."""
        if self.film.camera is not None:
            return self.cameras[self.film.camera]
        return next(iter(self.cameras.values()), self.camera)

    def seen_by(self, camera: Camera) -> Scene:
        """The scene with one camera, this one."""
        film = msgspec.structs.replace(self.film, camera=None)
        return msgspec.structs.replace(self, camera=camera, cameras={}, film=film)

    def points_to_frame(
        self, curves: Curves, meshes: Meshes | None = None
    ) -> tuple[NDArray[np.float32], float]:
        """Points (n, 3) of groom, body and meshes, and the radius of a sphere around each, to be
        framed."""
        points, radius = curves.points, float(curves.radii.max())
        others = self._framed_beside(meshes)
        return (np.concatenate([points, *others]) if others else points), radius
