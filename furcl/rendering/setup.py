"""From a scene to everything that rendering it needs on a device."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pyopencl as cl

from furcl.bvh import embree
from furcl.bvh.build import Bvh, build_bvh
from furcl.device import index_checks, layout
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.fibre import samplers
from furcl.fibre.material import FibreMaterial, build_material
from furcl.fibre.model import model_of
from furcl.groom.curves import Curves
from furcl.groom.joined import Grooms
from furcl.light.lights import Lights
from furcl.rendering.film import Film
from furcl.rendering.learning import Learning
from furcl.rendering.specialise import everything_on, scene_features
from furcl.rendering.wave_size import WaveSize, choose_wave_size
from furcl.rendering.wavefront import Wavefront
from furcl.scene.tables import Scene
from furcl.surface.kinds import ABSENT


@dataclass(frozen=True)
class GroomFacts:
    """A groom of a scene as rays meet it: its name, that of its material, and its size."""

    name: str
    material: str
    strands: int
    segments: int


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
    n_segments: int
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
    curves: Curves | Grooms | Future[Curves] | Future[Grooms] | None = None,
    with_target: bool = False,
) -> Setup:
    """Grow the groom and build its tree, while tables are made and kernels compiled.

    Parameters are those of furcl.rendering.renderer.Renderer.

    Raises
    ------
    GroomError, SceneError, ResourceError, KernelBuildError
    """
    timed = Timer()
    lights = scene.build_lights()
    fibres = scene.build_fibres()
    features = scene_features(scene, list(fibres.values()), lights, with_target)
    if not specialised:
        features = everything_on(features)

    def take_grooms() -> Grooms:
        with timed("curves"):
            given = curves.result() if isinstance(curves, Future) else curves
            return (scene.build_grooms() if given is None else Grooms.of(given)).traced()

    def point_radii(groom: Curves) -> bool:
        return not (specialised and groom.one_radius)

    def build_tree(grooms: Future[Grooms]) -> Bvh:
        grown = grooms.result().curves
        with timed("bvh"):
            return build_bvh(memory, grown, point_radii(grown), debug=features.debug)

    # Of the groom tables need nothing, and kernels its kind of radii but not the tree.
    with ThreadPoolExecutor(1) as beside:
        taken = beside.submit(take_grooms)
        tree = beside.submit(build_tree, taken)
        embree.load()
        if taken.done():
            taken.result()  # a file that cannot be used says so before tables are made
        with timed("tables"):
            materials = [
                _material(memory, scene, name, fibre, features, specialised)
                for name, fibre in fibres.items()
            ]
        grooms = taken.result()
        grown = grooms.curves
        features = features.with_(point_radii=point_radii(grown))
        size = choose_wave_size(memory.device, features, wave_size)
        film = Film.allocate(
            memory, scene.film.width, scene.film.height, features, scene.render.spp
        )
        with timed("compile"):
            wavefront = _wavefront(memory, scene, features, materials, lights, film, grown, size)
        learning = None
        if wavefront.learning:
            with timed("learning"):
                learning = Learning(
                    memory,
                    wavefront.learning,
                    grown,
                    scene.film.width * scene.film.height,
                    scene.render.survival_threshold,
                    scene.render.shadow_threshold,
                )
        built = tree.result()
        wavefront.place(built.arguments(), grooms.material_starts(len(materials)))
    return Setup(
        memory,
        features,
        [fibre.material for fibre in wavefront.fibres],
        _facts(grooms, list(fibres)),
        film,
        wavefront,
        learning,
        size,
        built.n_segments,
        lights.n_negative,
        timed.seconds,
    )


def _facts(grooms: Grooms, materials: list[str]) -> list[GroomFacts]:
    """What statistics say of grooms, in the order of their strands."""
    return [
        GroomFacts(
            groom.name, materials[groom.material], groom.curves.n_strands, groom.curves.n_segments
        )
        for groom in grooms.grooms
    ]


def _material(
    memory: Memory,
    scene: Scene,
    name: str,
    fibre: object,
    features: Features,
    specialised: bool,
) -> FibreMaterial:
    """A fibre of the scene on the device."""
    model, residual = model_of(fibre), scene.render.residual
    needed = model.features(fibre, residual=residual)
    return build_material(
        memory,
        fibre,
        features,
        samplers.find(scene.render.sampling),
        fibre_features=needed if specialised else needed.everything_on(),
        drop_lobes=specialised,
        name=name,
    )


def _wavefront(
    memory: Memory,
    scene: Scene,
    features: Features,
    materials: list[FibreMaterial],
    lights: Lights,
    film: Film,
    curves: Curves,
    size: WaveSize,
) -> Wavefront:
    """Compile the kernels and allocate what they work on."""
    middle = np.mean(curves.bounds(), axis=0) if lights.lamps else np.zeros(3)
    light = lights.device_buffer(features.light_sampling, middle)
    buffer: cl.Buffer = index_checks.upload(memory, "light", light, features.debug)
    return Wavefront(
        memory,
        features,
        [material.with_features(features) for material in materials],
        None if features.surface is None else (scene.body or ABSENT).params(),
        buffer,
        camera_struct(scene, curves),
        film,
        curves.n_points,
        size.paths,
    )


def camera_struct(scene: Scene, curves: Curves) -> np.ndarray:
    """The struct Camera of a scene; frames the groom where the scene leaves that open."""
    camera = scene.resolved_camera(curves)
    origin, right, up, forward = camera.frame()
    height = math.tan(0.5 * math.radians(camera.vfov_deg))
    out = np.zeros((), layout.struct_dtype("Camera"))
    out["origin"][:3] = origin
    out["right"][:3] = right * height * scene.film.aspect
    out["up"][:3] = up * height
    out["forward"][:3] = forward
    out["aperture_radius"] = camera.aperture_radius
    out["focus_distance"] = camera.focus_distance or 0.0
    out["filter_radius_px"] = scene.film.support_px
    return out
