"""The wavefront path tracer: scene in, picture out."""

from __future__ import annotations

import logging
import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pyopencl as cl

from furcl.bvh import embree
from furcl.bvh.build import BUFFERS, build_bvh
from furcl.device import index_checks, layout
from furcl.device.choice import Device, open_device
from furcl.device.features import LOBES, Features
from furcl.device.memory import Memory
from furcl.fibre.material import build_material
from furcl.groom.curves import Curves
from furcl.image.image import Image
from furcl.light.model import Light
from furcl.render.film import Film
from furcl.render.scene_structs import camera_struct
from furcl.render.specialise import everything_on, left_out, scene_features, summary
from furcl.render.wave_size import WaveSize
from furcl.render.wavefront import QueueLengths, Wavefront
from furcl.scene.read import with_overrides
from furcl.scene.tables import Scene
from furcl.surface.ellipsoid import body_struct
from furcl.version import software

log = logging.getLogger(__name__)

#: Called after every wave with the paths finished and the paths asked for; true stops the render.
Progress = Callable[[int, int], bool | None]

#: What the debug log says once, when the first wave is on the film.
FIRST_SAMPLES = "first samples are there"

# The device's counters of chosen lobes are read before so many rays could make them overflow.
RAYS_PER_LOBE_COUNT = 1 << 30


class Renderer:
    """Everything that a scene needs on one device; `advance` adds samples to its film.

    The picture is a function of scene, seed and number of samples: how the samples are cut into
    calls of `advance` and into waves changes no bit of it.

    Parameters
    ----------
    scene : Scene
    device : str, Device or None    as for `furcl.render`
    wave_size : int or None         paths traced together; None: what furcl.render.wave_size finds
    specialised : bool              False compiles what the scene does not need as well, for
                                    comparison (`furcl bench features`)
    curves : Curves, Future or None     the scene's groom, where it is there or on its way

    Attributes
    ----------
    seconds : dict[str, float]      curves (from here on), bvh, tables, compile, render [s]; the
                                    first two pass while the next two do
    samples_done : int              whole samples a pixel
    rays, shadow_rays : int         rays of all kinds, and those to lights
    hits, misses : int              what the others met: fibres and the body, or nothing

    Raises
    ------
    DeviceError, GroomError, SceneError, ResourceError, KernelBuildError
    """

    def __init__(
        self,
        scene: Scene,
        device: str | Device | None = None,
        wave_size: int | None = None,
        specialised: bool = True,
        curves: Curves | Future[Curves] | None = None,
    ) -> None:
        self.scene = scene
        self.device = device if isinstance(device, Device) else open_device(device)
        self.memory = Memory(self.device)
        self.seconds: dict[str, float] = {}
        self.lobe_counts = np.zeros(6, np.int64)
        self._forget_counts()
        light = scene.build_light()
        self.environment_pixels_clamped = light.n_negative
        fibre = scene.build_fibre()
        features = scene_features(scene, fibre, light)
        self._specialised = specialised
        if not specialised:
            features = everything_on(features)
        # Of the groom tables need nothing, and kernels its kind of radii but not the tree.
        with ThreadPoolExecutor(1) as beside:
            groom = beside.submit(self._take_groom, curves)
            geometry = beside.submit(self._build_geometry, groom, features)
            embree.load()
            if groom.done():
                groom.result()  # a file that cannot be used says so before tables are made
            with self._timed("tables"):
                self.material = build_material(self.memory, fibre, features, drop_lobes=specialised)
            curves = groom.result()
            self.features = self._with_groom(self.material.features, curves)
            self._prepare_stages(scene, curves, light, wave_size)
            self.wavefront.place(geometry.result())

    def _take_groom(self, curves: Curves | Future[Curves] | None) -> Curves:
        """Grow or read the groom, or wait for it."""
        with self._timed("curves"):
            given = curves.result() if isinstance(curves, Future) else curves
            return given or self.scene.build_curves()

    def _with_groom(self, features: Features, curves: Curves) -> Features:
        """Features without what the groom does not need."""
        return features.with_(point_radii=not (self._specialised and curves.one_radius))

    def _build_geometry(
        self, groom: Future[Curves], features: Features
    ) -> list[cl.Buffer | np.uint32]:
        """Build the tree on the device."""
        curves = groom.result()
        with self._timed("bvh"):
            point_radii = self._with_groom(features, curves).point_radii
            bvh = build_bvh(self.memory, curves, point_radii, debug=features.debug)
        self.n_segments = bvh.n_segments
        return bvh.arguments()

    def _prepare_stages(
        self, scene: Scene, curves: Curves, light: Light, wave_size: int | None
    ) -> None:
        """Compile the kernels and allocate what they work on."""
        light_data = light.device_buffer(self.features.light_sampling)
        self.film = Film.allocate(self.memory, scene.film.width, scene.film.height, self.features)
        self.wave_size = WaveSize(self.device, self.features, self.n_pixels, wave_size)
        with self._timed("compile"):
            self.wavefront = Wavefront(
                self.memory,
                self.features,
                self.material,
                index_checks.upload(self.memory, "environment", light_data, self.features.debug),
                camera_struct(scene, curves),
                body_struct(scene.body),
                self.film,
                curves.n_points,
                self.wave_size.capacity,
            )

    @property
    def n_pixels(self) -> int:
        """Pixels of the film."""
        return self.film.width * self.film.height

    @property
    def samples_done(self) -> int:
        """Whole samples that every pixel has."""
        return self.paths_done // self.n_pixels

    def restart(self, seed: int) -> None:
        """Forget all samples and their statistics; the next ones have another seed."""
        self.scene = with_overrides(self.scene, seed=seed)
        self.film.clear(self.device.queue)
        self._forget_counts()
        self.seconds.pop("render", None)

    def _forget_counts(self) -> None:
        self.paths_done = self.rays = self.shadow_rays = self.hits = self.misses = 0
        self._rays_with_lobes = 0
        self.lobe_counts[:] = 0

    def advance(
        self,
        spp: int,
        progress: Progress | None = None,
        time_limit: float | None = None,
    ) -> bool:
        """Add `spp` samples to every pixel.

        Stops between two waves when `time_limit` [s] of rendering is over or `progress` returns
        true; pixels may then differ by one sample, which the film knows. Returns whether all
        samples were added.
        """
        start, first = time.perf_counter(), self.paths_done
        end = first + spp * self.n_pixels
        with self._timed("render"):
            while self.paths_done < end:
                if time_limit is not None and time.perf_counter() - start >= time_limit:
                    break
                began = time.perf_counter()
                wave = self._next_wave(end)
                self._trace(wave)
                if not self.paths_done:
                    self.device.queue.finish()
                    log.debug(FIRST_SAMPLES)
                self.paths_done += int(wave["n_paths"])
                self.wave_size.record(int(wave["n_paths"]), time.perf_counter() - began)
                if self.rays - self._rays_with_lobes > RAYS_PER_LOBE_COUNT:
                    self._count_lobes()
                if progress and progress(self.paths_done - first, end - first):
                    break
            self._count_lobes()
            self.device.queue.finish()
        return self.paths_done == end

    def settle(self) -> None:
        """Add samples until the wave size is found, so that what follows can be timed."""
        while self.wave_size.probing:
            self.advance(1)

    def _trace(self, wave: np.ndarray) -> None:
        """One wave from the camera to the film.

        The host is one bounce ahead of the device: a bounce is launched over as many paths as the
        bounce before it began with, and the device, which knows better, never waits for the host.
        """
        stages = self.wavefront
        active = stages.generate(wave)
        self.rays += active
        lengths = None
        for depth in range(self.scene.render.max_depth + 1):
            stages.intersect_closest(wave, active)
            stages.shade_escaped(wave, active)
            if depth < self.scene.render.max_depth:
                stages.sample_lobe_h(wave, active, depth)
                stages.shade(wave, active, depth)
                stages.intersect_shadow(wave, active)
            before, lengths = lengths, stages.swap()
            if before:
                active = self._count_rays(before)
                if not active:
                    break
        stages.add_to_film(wave)
        if lengths:
            self._count_rays(lengths)

    def _count_rays(self, lengths: QueueLengths) -> int:
        """Count what a bounce met and the rays that it leads to; returns how many paths go on."""
        counts = lengths.wait()
        active, shadows = int(counts[layout.COUNT_NEXT]), int(counts[layout.COUNT_SHADOWS])
        self.rays += active + shadows
        self.shadow_rays += shadows
        self.hits += int(counts[layout.COUNT_HITS])
        self.misses += int(counts[layout.COUNT_MISSES])
        return active

    def _count_lobes(self) -> None:
        """Take the counts of chosen lobes over from the device."""
        if self.features.statistics:
            counted = self.wavefront.read_lobe_counts()
            self.lobe_counts[: len(counted)] += counted
        self._rays_with_lobes = self.rays

    def _next_wave(self, end: int) -> np.ndarray:
        """The struct Wave of the paths from `paths_done` on."""
        sample, pixel = divmod(self.paths_done, self.n_pixels)
        wave = np.zeros((), layout.struct_dtype("Wave"))
        wave["width"], wave["height"] = self.film.width, self.film.height
        wave["first_pixel"], wave["first_sample"] = pixel, sample
        wave["n_paths"] = min(self.wave_size.limit(), end - self.paths_done)
        wave["n_slots"] = self.wavefront.n_slots
        wave["seed"] = self.scene.render.seed
        wave["roulette_depth"] = self.scene.render.roulette_depth
        return wave

    def image(self) -> Image:
        """The picture so far, with its statistics."""
        mean, variance, _ = self.film.read(self.memory)
        return Image(
            rgb=mean,
            variance=variance,
            stats=self.stats(),
            exposure_stops=self.scene.film.exposure_stops,
        )

    def stats(self) -> dict:
        """What `--stats` writes; times in seconds, sizes in bytes."""
        render = self.seconds.get("render", 0.0)
        names = (*LOBES, "residual")
        return {
            **software(),
            "scene": self.scene.name,
            "environment_pixels_clamped": self.environment_pixels_clamped,
            "device": self.device.name,
            "platform": self.device.platform,
            "driver": self.device.driver_version,
            "seed": self.scene.render.seed,
            "spp": self.samples_done,
            "sampling": self.scene.render.sampling,
            "width": self.film.width,
            "height": self.film.height,
            "segments": self.n_segments,
            "features": {
                "compiled": self.features.as_dict(),
                "left_out": left_out(self.features),
            },
            "seconds": dict(self.seconds),
            "paths": self.paths_done,
            "rays": self.rays,
            "mrays_s": self.rays / render / 1e6 if render else 0.0,
            "path_length": (self.rays - self.shadow_rays) / max(self.paths_done, 1),
            "hits_per_path": int(self.lobe_counts.sum()) / max(self.paths_done, 1),
            "lobes": {
                name: int(self.lobe_counts[i])
                for i, name in enumerate(names[: self.features.n_lobes])
            },
            "nonfinite": self.film.read_nonfinite(self.memory),
            "bytes": {
                "host_peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
                "device_peak": self.memory.peak_bytes,
                "bvh": sum(self.memory.bytes[name] for name in BUFFERS),
                "tables": self.memory.bytes["tables"] + self.memory.bytes["profiles"],
            },
            "wave_size": self.wave_size.paths,
            "wave_size_from": self.wave_size.origin,
        }

    @contextmanager
    def _timed(self, name: str):
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def render(
    scene: Scene | str | os.PathLike,
    *,
    spp: int | None = None,
    seed: int | None = None,
    sampling: str | None = None,
    max_depth: int | None = None,
    device: str | Device | None = None,
    progress: Progress | None = None,
    time_limit: float | None = None,
    wave_size: int | None = None,
    curves: Curves | Future[Curves] | None = None,
) -> Image:
    """Render a scene.

    Parameters
    ----------
    scene : Scene or path of a scene file
    spp, seed, sampling, max_depth      override those of the scene
    device : str or None                index or part of the name; None: FURCL_DEVICE, then the rule
    progress : callable or None         called with (paths done, paths asked for) after every wave;
                                        stops the render by returning true
    time_limit : float or None          stop between waves after this time [s]
    wave_size : int or None             paths traced together; changes no bit of the result; None:
                                        what is fastest on the device
    curves : Curves, Future or None     the scene's groom, where it is there or on its way

    Returns
    -------
    Image       linear radiance, variance of the mean, stats; stats["complete"] is false where the
                render was stopped before all samples were taken

    Raises
    ------
    SceneError, GroomError, FibreError, DeviceError, ResourceError, KernelBuildError
    """
    if not isinstance(scene, Scene):
        from furcl.scene.read import load_scene

        scene = load_scene(scene)
    scene = with_overrides(scene, spp=spp, seed=seed, sampling=sampling, max_depth=max_depth)
    renderer = Renderer(scene, device, wave_size, curves=curves)
    log.info(
        "%s",
        summary(renderer.features, renderer.memory.total_bytes, renderer.seconds["compile"]),
    )
    complete = renderer.advance(scene.render.spp, progress, time_limit)
    image = renderer.image()
    image.stats["complete"] = complete
    return image
