"""From a scene to everything that rendering it needs on a device."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl

from furcl.bvh import embree
from furcl.bvh.build import BUFFERS, Bvh, build_bvh
from furcl.device import index_checks, layout
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.errors import GroomError
from furcl.fibre import samplers
from furcl.fibre.absorption import unused_attributes
from furcl.fibre.material import FibreMaterial, build_material
from furcl.fibre.model import model_of
from furcl.fibre.packed import Packed, bind
from furcl.groom.curves import Curves
from furcl.groom.joined import Groom, Grooms
from furcl.groom.optical_depth import OpticalDepths, optical_depths
from furcl.light.lights import Lights
from furcl.rendering.arguments import Given
from furcl.rendering.film import Film
from furcl.rendering.learning import Learning
from furcl.rendering.shutter import shutter_words
from furcl.rendering.specialise import everything_on, scene_features
from furcl.rendering.wave_size import WaveSize, choose_wave_size
from furcl.rendering.wavefront import Wavefront
from furcl.scene.camera import Camera
from furcl.scene.tables import Film as FilmTable
from furcl.scene.tables import Scene
from furcl.surface.kinds import ABSENT
from furcl.surface.mesh.mesh import Meshes, MeshPart

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class GroomFacts:
    """A groom of a scene as rays meet it: its name, that of its material, and its size."""

    name: str
    material: str
    strands: int
    segments: int


@dataclass(frozen=True, eq=False)
class Geometry:
    """What follows from grooms and meshes alone.

    Attributes
    ----------
    tree : Bvh                      that rays are sent through
    depths : OpticalDepths or None  of the grooms, where something is learned while rendering
    """

    tree: Bvh
    depths: OpticalDepths | None = None


@dataclass(frozen=True, eq=False)
class Setup:
    """Everything that a scene needs on one device.

    Attributes
    ----------
    memory : Memory             holds all buffers
    features : Features         of the scene; those of materials are these with their parts
    materials : list            FibreMaterial each, in the order of the scene
    grooms : list               GroomFacts each, in the order of their strands
    learning : Learning or None     where something is learned while rendering
    seconds : dict              curves (from here on), bvh, tables, compile [s]; the first two pass
                                while the next two do; learning [s] where there is some
    geometry : Geometry
    middle : (3,) float64       of the grooms' box: where the light's strength is taken
    times : floats              of the groom's time steps, if it moves
    n_negative : int            values of the light below zero, which were set to zero
    """

    memory: Memory
    features: Features
    materials: list[FibreMaterial]
    grooms: list[GroomFacts]
    film: Film
    wavefront: Wavefront
    learning: Learning | None
    wave_size: WaveSize
    geometry: Geometry
    middle: np.ndarray
    times: tuple[float, ...]
    n_negative: int
    seconds: dict[str, float]


class Timer:
    """Adds up the seconds of what is done under a name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def set_up(
    memory: Memory,
    scene: Scene,
    *,
    wave_size: int | None = None,
    specialised: bool = True,
    curves: Given = None,
    with_target: bool = False,
    with_held: bool = False,
    adjustable: bool = False,
    geometry: Geometry | None = None,
) -> Setup:
    """Grow the groom and build its tree, while tables are made and kernels compiled.

    Parameters are those of furcl.rendering.renderer.Renderer.

    Raises
    ------
    GroomError, SceneError, ResourceError, KernelBuildError
    """
    timed = Timer()
    meshes = scene.build_meshes()
    lights = scene.build_lights(meshes)
    fibres = scene.build_fibres()
    features = scene_features(scene, list(fibres.values()), lights, meshes, with_target).with_(
        held=with_held
    )

    def take_grooms() -> Grooms:
        with timed("curves"):
            given = curves.result() if isinstance(curves, Future) else curves
            return (scene.build_grooms() if given is None else _given(scene, given)).traced()

    def point_radii(groom: Curves) -> bool:
        return not (specialised and groom.one_radius) or groom.steps is not None

    def build_tree(grooms: Future[Grooms]) -> Bvh:
        grown = grooms.result().curves
        if geometry:
            memory.share(geometry.tree.memory, BUFFERS)
            return geometry.tree
        with timed("bvh"):
            corners = None if meshes is None else meshes.corners()
            return build_bvh(memory, grown, point_radii(grown), corners, debug=features.debug)

    # Of the groom tables need nothing, and kernels its kind of radii but not the tree.
    with ThreadPoolExecutor(1) as beside:
        taken = beside.submit(take_grooms)
        tree = beside.submit(build_tree, taken)
        embree.load()
        if taken.done():
            taken.result()  # a file that cannot be used says so before tables are made
        bound: dict[str, Packed] = {}
        if any(table.absorption for table in scene.materials().values()):
            with timed("tables"):
                bound = _bind(scene, fibres, taken.result())
            fibres |= {name: _bound_fibre(fibres[name], packed) for name, packed in bound.items()}
            grey = all(packed.grey for packed in bound.values())
            features = scene_features(
                scene, list(fibres.values()), lights, meshes, with_target, grey
            ).with_(held=with_held)
        if not specialised:
            features = everything_on(features)
        elif adjustable:
            features = features.with_(channels=3, crop=True)
        of_fibres = specialised and not adjustable
        with timed("tables"):
            materials = [
                scene_material(memory, scene, name, fibre, features, of_fibres, bound.get(name))
                for name, fibre in fibres.items()
            ]
        grooms = taken.result()
        _name_unused(scene, grooms)
        grown = grooms.curves
        features = features.with_(
            point_radii=point_radii(grown), motion=max(len(grown.times) - 1, 0)
        )
        size = choose_wave_size(memory.device, features, wave_size)
        window, middle = scene.film.window, np.mean(grown.bounds(), axis=0)
        film = Film.allocate(memory, window.width, window.height, features, scene.render.spp)
        with timed("compile"):
            wavefront = _wavefront(
                memory, scene, features, materials, meshes, lights, middle, film, grown, size
            )
        learning, depths = None, geometry.depths if geometry else None
        if wavefront.learning:
            with timed("learning"):
                depths = depths or optical_depths(grown)
                learning = Learning(
                    memory,
                    wavefront.learning,
                    depths,
                    window.n_pixels,
                    scene.render.survival_threshold,
                    scene.render.shadow_threshold,
                )
        if film.layers:
            film.layers.place(grooms, _surfaces(scene, features), scene.placed_lamps())
        wavefront.place(tree.result(), grooms.material_starts(len(materials)))
    return Setup(
        memory,
        features,
        [fibre.material for fibre in wavefront.fibres],
        _facts(grooms, list(fibres)),
        film,
        wavefront,
        learning,
        size,
        Geometry(tree.result(), depths),
        middle,
        grown.times,
        lights.n_negative,
        timed.seconds,
    )


def _given(scene: Scene, curves: Curves | Grooms) -> Grooms:
    """The grooms of a scene, where the caller has them, while the shutter is open.

    Raises
    ------
    GroomError      curves for a scene of several grooms
    """
    if isinstance(curves, Grooms):
        return curves.during(scene.chosen_camera.shutter)
    names = list(scene.grooms())
    if len(names) > 1:
        raise GroomError(
            f"curves are given, and scene {scene.name!r} has {len(names)} grooms, "
            f"{', '.join(names)}; give what its build_grooms() returns, or leave curves out"
        )
    return Grooms([Groom(names[0], curves)]).during(scene.chosen_camera.shutter)


def _name_unused(scene: Scene, grooms: Grooms) -> None:
    """Say in the log which arrays of grooms nothing uses."""
    tables = list(scene.materials().values())
    for groom in grooms.grooms:
        unused = unused_attributes(groom.curves, tables[groom.material].absorption)
        if unused:
            log.info("groom %s: nothing uses its %s", groom.name, ", ".join(unused))


def _facts(grooms: Grooms, materials: list[str]) -> list[GroomFacts]:
    """What statistics say of grooms, in the order of their strands."""
    return [
        GroomFacts(
            groom.name, materials[groom.material], groom.curves.n_strands, groom.curves.n_segments
        )
        for groom in grooms.grooms
    ]


def scene_material(
    memory: Memory,
    scene: Scene,
    name: str,
    fibre: object,
    features: Features,
    specialised: bool,
    bound: Packed | None,
    profiles: Any = None,
) -> FibreMaterial:
    """A fibre of the scene on the device; not specialised: with all code that others of its model
    could need. `profiles` stand for what the model prepares."""
    varies = bound is not None and bound.by != "constant"
    model, residual = model_of(fibre), scene.render.residual
    features = features.with_(mode=scene.materials()[name].mode)
    needed = model.features(fibre, residual=residual)
    return build_material(
        memory,
        fibre,
        features.with_(absorption=bound.by) if bound and varies else features,
        samplers.find(scene.render.sampling),
        fibre_features=needed if specialised else needed.everything_on(),
        drop_lobes=specialised,
        profiles=profiles,
        name=name,
        absorbs=bound.absorbs if bound and varies else None,
        absorption=bound.words if bound and varies else None,
    )


def _bind(scene: Scene, fibres: dict[str, Any], grooms: Grooms) -> dict[str, Packed]:
    """What differs between the strands of each material that says so."""
    bound = {}
    for number, (name, table) in enumerate(scene.materials().items()):
        if table.absorption and grooms.of_material(number):
            fibre = fibres[name]
            bound[name] = bind(table.absorption, model_of(fibre), fibre, grooms, number)
    return bound


def _bound_fibre(fibre: Any, bound: Packed) -> Any:
    """A fibre with the largest absorption that its strands have."""
    return model_of(fibre).with_absorption(fibre, bound.sigma)


def _wavefront(
    memory: Memory,
    scene: Scene,
    features: Features,
    materials: list[FibreMaterial],
    meshes: Meshes | None,
    lights: Lights,
    middle: np.ndarray,
    film: Film,
    curves: Curves,
    size: WaveSize,
) -> Wavefront:
    """Compile the kernels and allocate what they work on."""
    buffer = upload_lights(memory, lights, features, middle)
    shading = None
    if meshes and isinstance(features.meshes, MeshPart):
        lit = sum(len(mesh.triangles) for mesh in meshes.lamps)
        first_lamp = lights.lamps.n_placed - lit if lights.lamps else 0
        shading = memory.upload("mesh shading", meshes.shading(features.meshes, first_lamp))
    camera = scene.resolved_camera(curves, meshes)
    return Wavefront(
        memory,
        features,
        [material.with_features(features) for material in materials],
        surface_struct(scene, features),
        shading,
        buffer,
        camera_struct(camera, scene.film),
        shutter_words(camera, curves.times),
        film,
        curves.n_points,
        size.paths,
    )


def upload_lights(
    memory: Memory, lights: Lights, features: Features, middle: np.ndarray
) -> cl.Buffer:
    """The light of a scene on the device; `middle` (3,) is where its strength is taken."""
    words = lights.device_buffer(features.light_sampling, middle)
    return index_checks.upload(memory, "light", words, features.debug)


def surface_struct(scene: Scene, features: Features) -> np.ndarray | None:
    """The struct SurfaceParams of what lies beside the strands, where kernels have a surface."""
    return None if features.surface is None else (scene.body or ABSENT).params()


def _surfaces(scene: Scene, features: Features) -> list[str]:
    """Names of what rays meet beside fibres and lamps, as cryptomattes have them."""
    body = [] if features.surface is None else ["body"]
    return [*body, *(f"mesh.{name}" for name in scene.mesh)]


def camera_struct(camera: Camera, film: FilmTable) -> np.ndarray:
    """The struct Camera of a resolved camera, of one that moves as the shutter opens."""
    origin, right, up, forward = camera.frame()
    height = camera.half_height
    out = np.zeros((), layout.struct_dtype("Camera"))
    out["origin"][:3] = origin
    out["right"][:3] = right * height * film.aspect
    out["up"][:3] = up * height
    out["forward"][:3] = forward
    out["aperture_radius"] = camera.aperture_radius
    out["focus_distance"] = camera.focus_distance or 0.0
    out["filter_radius_px"] = film.support_px
    return out


def wave_struct(scene: Scene, wavefront: Wavefront) -> np.ndarray:
    """The struct Wave with what all waves of a scene have alike."""
    wave = np.zeros((), layout.struct_dtype("Wave"))
    window = scene.film.window
    wave["width"], wave["height"] = window.width, window.height
    wave["picture_width"], wave["picture_height"] = window.full_width, window.full_height
    wave["crop_left"], wave["crop_top"] = window.left, window.top
    wave["n_slots"] = wavefront.n_slots
    wave["roulette_depth"] = scene.render.first_roulette
    wave["roulette_threshold"] = scene.render.survival_threshold
    wave["shadow_threshold"] = scene.render.shadow_threshold
    return wave
