"""A renderer that follows a scene which changes, with as little made anew as the change allows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import msgspec
import pyopencl as cl

from furcl.device.choice import Device
from furcl.errors import ResourceError, SceneError
from furcl.fibre.model import model_of
from furcl.groom.joined import Grooms
from furcl.light.lights import Lights
from furcl.rendering.adjustable import AdjustableRenderer
from furcl.rendering.setup import Geometry
from furcl.scene.camera import Camera
from furcl.scene.tables import Scene

#: Paths of a wave on CPUs: a change waits for the end of one.
CPU_WAVE = 1 << 14
GPU_WAVE = 1 << 18
#: Tables of a scene, and keys of [render], that a renderer takes others of.
LIT_BY = ("environment", "lamp", "body")
ENDS_OF_PATHS = ("max_depth", "roulette_depth", "roulette_threshold", "shadow_threshold")


class Follower:
    """Holds the renderer of the scene that was followed last.

    Attributes
    ----------
    device : Device
    renderer : AdjustableRenderer or None       None until the first scene is followed
    drafted : set of str                        materials that are there as drafts
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self.renderer: AdjustableRenderer | None = None
        self.drafted: set[str] = set()
        self._scene: Scene | None = None
        self._camera: Camera | None = None
        self._grooms: Grooms | None = None
        self._of_grooms: Any = None
        self._geometry: Geometry | None = None
        self._of_meshes: Any = None
        self._lights: tuple[Any, Lights] | None = None
        self._beside = ThreadPoolExecutor(1, "prepare")
        self._preparing: Future[dict[str, tuple[Any, Any]]] | None = None

    def needs_set_up(self, scene: Scene) -> bool:
        """Whether a scene needs more than another camera, window, light or numbers of fibres."""
        if self.renderer is None or self._scene is None:
            return True
        if scene.film.window.n_pixels > self.renderer.most_pixels:
            return True
        return _fixed(scene) != _fixed(self._scene) or (
            scene.build_fibres() != self._scene.build_fibres()
            and any(table.absorption for table in scene.materials().values())
        )

    def follow(self, scene: Scene) -> bool:
        """Make the renderer one of the scene; returns whether it has no samples of it yet.

        Raises
        ------
        FurclError      what setting up raises; the renderer is then that of the scene before
        """
        if self._scene and self.renderer and _picture(scene) == _picture(self._scene):
            self.set_spp(scene.render.spp)
            self._scene = scene
            return False
        if not self.needs_set_up(scene):
            try:
                self._adjust(scene)
                return True
            except (SceneError, ResourceError):  # needs other kernels
                pass
        self._set_up(scene)
        return True

    def set_spp(self, spp: int) -> None:
        """Samples that `advance` ends with."""
        assert self.renderer is not None
        render = msgspec.structs.replace(self.renderer.scene.render, spp=spp)
        self.renderer.scene = msgspec.structs.replace(self.renderer.scene, render=render)

    def prepare(self, done: Callable[[], None]) -> None:
        """Prepare what is there as a draft, beside the render; call a function when it is done."""
        if self._preparing is None and self.drafted:
            assert self._scene is not None
            fibres = self._scene.build_fibres()
            wanted = {name: fibres[name] for name in self.drafted}
            queue = cl.CommandQueue(self.device.context)
            self._preparing = self._beside.submit(
                _prepared, replace(self.device, queue=queue), wanted
            )
            self._preparing.add_done_callback(lambda _: done())

    @property
    def is_prepared(self) -> bool:
        """Whether `refine` has something to do."""
        return self._preparing is not None and self._preparing.done()

    def refine(self) -> bool:
        """Take what was prepared, if it still is of the scene's fibres; returns whether it was: the
        renderer then has no samples.

        Raises
        ------
        FurclError      what preparing raised
        """
        assert self._preparing is not None
        assert self.renderer is not None
        assert self._scene is not None
        fibres = self._scene.build_fibres()
        found, self._preparing = self._preparing, None
        made = {
            name: prepared
            for name, (fibre, prepared) in found.result().items()
            if name in self.drafted and fibres[name] == fibre
        }
        if made:
            wanted = {name: fibres[name] for name in made}
            self.renderer.change_fibres(self._scene, wanted, made)
            self.drafted -= made.keys()
        return bool(made)

    def close(self) -> None:
        """Wait for what is being prepared."""
        self._beside.shutdown(cancel_futures=True)

    @property
    def camera(self) -> Camera | None:
        """The camera that sees the scene, resolved; None before there is one."""
        return self._camera

    def resolved(self, scene: Scene) -> Camera:
        """The resolved camera of a scene of the same grooms."""
        assert self._grooms is not None
        return scene.resolved_camera(self._grooms.curves, scene.build_meshes())

    def _adjust(self, scene: Scene) -> None:
        renderer, before = self.renderer, self._scene
        assert renderer is not None
        assert before is not None
        # What can be refused comes before the first change.
        camera = self._camera
        framing = scene.chosen_camera.origin is None and _framing(scene) != _framing(before)
        if scene.chosen_camera != before.chosen_camera or framing:
            camera = self.resolved(scene)
        assert camera is not None
        lights = self._built_lights(scene) if _lit(scene) != _lit(before) else None
        fibres, old = scene.build_fibres(), before.build_fibres()
        changed = {name: fibre for name, fibre in fibres.items() if fibre != old[name]}
        if changed:
            self.drafted -= changed.keys()
            self.drafted |= renderer.change_fibres(scene, changed)
        if lights:
            renderer.change_lights(scene, lights)
        renderer.look(camera)
        seen = scene.seen_by(camera)
        renderer.scene = seen
        renderer.show(seen.film)
        self._scene, self._camera = scene, camera

    def _built_lights(self, scene: Scene) -> Lights:
        of_lights = scene.environment, dict(scene.lamp), scene.render.lamp_choice
        if self._lights is None or self._lights[0] != of_lights:
            self._lights = of_lights, scene.build_lights()
        return self._lights[1]

    def _set_up(self, scene: Scene) -> None:
        of_grooms, of_meshes = _of_grooms(scene), msgspec.to_builtins(scene.mesh)
        if of_grooms != self._of_grooms or self._grooms is None:
            grooms, geometry = scene.build_grooms(), None
        else:
            grooms, geometry = self._grooms, self._geometry
        if of_meshes != self._of_meshes:
            geometry = None
        camera = scene.resolved_camera(grooms.curves, scene.build_meshes())
        wave = CPU_WAVE if self.device.is_cpu else GPU_WAVE
        renderer = AdjustableRenderer(scene.seen_by(camera), self.device, wave, grooms, geometry)
        self._geometry, self._of_meshes = renderer.setup.geometry, of_meshes
        self.renderer, self._scene, self._camera = renderer, scene, camera
        self._grooms, self._of_grooms = grooms, of_grooms
        self.drafted.clear()


def _prepared(device: Device, fibres: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Name -> fibre and what its model prepares for it."""
    return {name: (fibre, model_of(fibre).prepare(device, fibre)) for name, fibre in fibres.items()}


def _picture(scene: Scene) -> Any:
    """What a picture follows from, but the number of its samples, as plain values."""
    document = msgspec.to_builtins(scene)
    del document["name"], document["film"]["exposure_stops"], document["render"]["spp"]
    return document


def _fixed(scene: Scene) -> Any:
    """What a renderer keeps of a scene, as plain values."""
    document = msgspec.to_builtins(scene)
    camera = scene.chosen_camera
    lights = [*scene.lamp.items(), ("environment", scene.environment), ("body", scene.body)]
    kinds = [(name, type(table)) for name, table in lights]
    if not scene.has_bright_meshes:
        for name in LIT_BY:
            document.pop(name)
    for name in ("name", "camera", "cameras", "fibre", "material"):
        document.pop(name)
    for name in ("width", "height", "crop", "exposure_stops", "camera"):
        document["film"].pop(name)
    for name in ("spp", "seed", *ENDS_OF_PATHS):
        document["render"].pop(name)
    for groom in document["groom"].values():
        groom.pop("fibre")
    kernels = (
        camera.orthographic,
        camera.aperture_radius > 0.0,
        len(camera.places),
        camera.shutter,
        scene.render.first_roulette < scene.render.max_depth,
        scene.render.roulette == "adjoint" or scene.render.shadow_threshold > 0.0,
    )
    fibres = [
        (name, type(table), table.mode, table.absorption)
        for name, table in scene.materials().items()
    ]
    return document, kinds, kernels, fibres


def _framing(scene: Scene) -> Any:
    """What a camera that frames follows from, beside grooms and meshes."""
    return scene.film.aspect, scene.body


def _lit(scene: Scene) -> Any:
    """What `AdjustableRenderer.change_lights` takes of a scene, as plain values."""
    document = msgspec.to_builtins(scene)
    of_render = [document["render"][name] for name in ENDS_OF_PATHS]
    return [document[name] for name in LIT_BY], of_render


def _of_grooms(scene: Scene) -> Any:
    """What grooms follow from, as plain values."""
    document = msgspec.to_builtins(scene)
    shutter = scene.chosen_camera.shutter
    grooms = {name: {**groom, "fibre": None} for name, groom in document["groom"].items()}
    numbers = [scene.material_name(name) for name in scene.grooms()]
    return document["curves"], grooms, shutter, numbers
