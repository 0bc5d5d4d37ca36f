"""The wavefront path tracer: scene in, picture out."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable

import numpy as np

from furcl.device import layout
from furcl.device.choice import Device, open_device
from furcl.device.memory import Memory
from furcl.errors import SceneError
from furcl.image.error import estimated_errors
from furcl.image.image import Image
from furcl.image.size import Window
from furcl.image.tev import parse_address
from furcl.progress import showing_progress
from furcl.rendering.arguments import Given, check_curves, check_samples, check_stops
from furcl.rendering.checkpoint import Checkpoints, check_checkpoints, go_on
from furcl.rendering.display import Shown
from furcl.rendering.held import Held
from furcl.rendering.plan import SamplePlan
from furcl.rendering.setup import Geometry, Setup, camera_struct, set_up, wave_struct
from furcl.rendering.shutter import shutter_words
from furcl.rendering.specialise import summary
from furcl.rendering.state import read_header
from furcl.rendering.statistics import statistics
from furcl.rendering.target import Target
from furcl.rendering.wavefront import QueueLengths
from furcl.scene.camera import Camera
from furcl.scene.read import with_overrides
from furcl.scene.tables import MOST_SPP, Scene

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
    wave_size : int or None         paths traced together; None: by furcl.rendering.wave_size
    specialised : bool              False compiles what the scene does not need as well, for
                                    comparison (`furcl bench features`)
    curves : Curves, Grooms, Future or None     the scene's groom or grooms, where they are there or
                                    on their way
    target : Target or None         error at which `advance` stops before it has all samples
    held : Held or None             numbers that all samples of a pixel share; where this is not
                                    None, the attribute may be changed between calls of `advance`
    adjustable : bool               compile all that furcl.rendering.adjustable could need
    geometry : Geometry or None     of a renderer of the same grooms and meshes on the device

    Attributes
    ----------
    setup : Setup                   what the scene has on the device; its features, materials, film
                                    and wavefront are attributes of the renderer too
    material : FibreMaterial        the first of the materials
    seconds : dict[str, float]      those of the set-up, and render [s]
    samples_done : int              whole samples a pixel, on average
    first_sample : int              number of the first sample of every pixel; 0 with a plan
    rays, shadow_rays : int         rays of all kinds, and those to lights
    hits, misses : int              what the others met: fibres and surfaces, or nothing
    surface_hits : int              hits on surfaces

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
        curves: Given = None,
        target: Target | None = None,
        held: Held | None = None,
        adjustable: bool = False,
        geometry: Geometry | None = None,
    ) -> None:
        check_curves(curves)
        if held and scene.render.sequence != "independent":
            raise SceneError(
                f"scene {scene.name!r}: render.sequence = {scene.render.sequence!r}: numbers can "
                f"be held where samples are independent; set it to 'independent'"
            )
        self.scene = scene
        self.device = device if isinstance(device, Device) else open_device(device)
        self.memory = Memory(self.device)
        self.setup: Setup = set_up(
            self.memory,
            scene,
            wave_size=wave_size,
            specialised=specialised,
            curves=curves,
            with_target=target is not None,
            with_held=held is not None,
            adjustable=adjustable,
            geometry=geometry,
        )
        self.features = self.setup.features
        self.materials = self.setup.materials
        self.material = self.materials[0]
        self.film = self.setup.film
        self.wavefront = self.setup.wavefront
        self.wave_size = self.setup.wave_size
        self.seconds = dict(self.setup.seconds)
        self.target = target
        self.held = held
        self.first_sample = 0
        self.plan: SamplePlan | None = None
        if self.film.plan:
            even = scene.render.allocation == "even"
            learning = self.setup.learning
            stops = [n // self.n_pixels for n in learning.ends] if learning else []
            self.plan = SamplePlan(self.memory, self.film, even, target, stops)
        self._wave = wave_struct(scene, self.wavefront)
        self.lobe_counts = [np.zeros(len(m.lobes), np.int64) for m in self.materials]
        self.material_hits = np.zeros(len(self.materials), np.int64)
        self._forget_counts()

    @property
    def window(self) -> Window:
        """What the film holds of the picture."""
        return self.scene.film.window

    @property
    def n_pixels(self) -> int:
        """Pixels of the film."""
        return self.film.width * self.film.height

    @property
    def lobes(self) -> dict[str, int]:
        """Name of each lobe -> how often it was chosen, in all materials."""
        chosen: dict[str, int] = {}
        for material, counts in zip(self.materials, self.lobe_counts, strict=True):
            for name, count in zip(material.lobes, counts.tolist(), strict=True):
                chosen[name] = chosen.get(name, 0) + count
        return chosen

    @property
    def samples_done(self) -> int:
        """Whole samples that every pixel has, on average where they have different numbers."""
        return self.paths_done // self.n_pixels

    def restart(self, seed: int, first_sample: int = 0) -> None:
        """Forget all samples and their statistics; the next ones have another seed, and every
        pixel begins with another of its samples.

        Raises
        ------
        SceneError      `first_sample` above 0 where pixels take different numbers of samples
        """
        if first_sample and self.plan:
            raise SceneError(
                f"scene {self.scene.name!r}: its pixels take different numbers of samples, so none "
                f"begins with sample {first_sample}; set render.allocation = 'even' and no target, "
                f"or render with another seed"
            )
        self.first_sample = first_sample
        self.empty_film(seed)
        if self.plan:
            self.plan.restart()
        self._forget_counts()
        if self.setup.learning:
            self.setup.learning.forget()
        self.seconds.pop("render", None)

    def empty_film(self, seed: int) -> None:
        """Take all samples out of the film; the next ones have another seed and are counted on, and
        what was learned stays. Without a plan."""
        if type(seed) is not int or seed != self.scene.render.seed:  # checks cost time
            self.scene = with_overrides(self.scene, seed=seed)
        self.film.clear(self.device.queue)

    def look(self, camera: Camera) -> None:
        """Forget all samples; the next ones are seen by another camera.

        Parameters
        ----------
        camera : Camera     resolved, of the scene's projection; without a lens if it has none

        Raises
        ------
        SceneError          a camera for which the kernels are not built
        """
        another_lens = camera.aperture_radius > 0.0 and not self.features.lens
        if another_lens or camera.orthographic != self.features.orthographic:
            raise SceneError(
                f"scene {self.scene.name!r}: its kernels are built for another "
                f"{'lens' if another_lens else 'projection'} than the camera's; make another "
                f"Renderer"
            )
        moves = len(camera.places) - 1 != self.features.camera_motion
        if moves or camera.shutter != self.scene.chosen_camera.shutter:
            raise SceneError(
                f"scene {self.scene.name!r}: its kernels and its grooms are made for another "
                f"{'number of keys' if moves else 'shutter'} than the camera's; make another "
                f"Renderer"
            )
        self.scene = self.scene.seen_by(camera)
        self.wavefront.look(
            camera_struct(camera, self.scene.film), shutter_words(camera, self.setup.times)
        )
        self.restart(self.scene.render.seed)

    def _forget_counts(self) -> None:
        self.paths_done = self.rays = self.shadow_rays = 0
        self.hits = self.surface_hits = self.misses = 0
        self._rays_with_lobes = 0
        for counts in (*self.lobe_counts, self.material_hits):
            counts[:] = 0

    def advance(
        self,
        spp: int | None = None,
        progress: Progress | None = None,
        time_limit: float | None = None,
    ) -> bool:
        """Add `spp` samples to every pixel, on average where they take different numbers; None:
        what is missing of the scene's number, where progress counts all paths.

        Stops between two waves when `time_limit` [s] of rendering is over or `progress` returns
        true; pixels may then differ by one sample, with a plan by those of a step, which the film
        knows. Returns whether all samples were added; with a target, whether it is reached.
        """
        start, reached = time.perf_counter(), False
        first = 0 if spp is None else self.paths_done
        end = first + (self.scene.render.spp if spp is None else spp) * self.n_pixels
        try:
            while self.paths_done < end:
                if time_limit is not None and time.perf_counter() - start >= time_limit:
                    break
                wave, n_pixels = self._next_wave(end)
                if not n_pixels:
                    reached = True
                    break
                self._trace(wave, n_pixels)
                if not self.paths_done:
                    self.device.queue.finish()
                    log.debug(FIRST_SAMPLES)
                self.paths_done += int(wave["n_paths"])
                self._learn()
                if self.rays - self._rays_with_lobes > RAYS_PER_LOBE_COUNT:
                    self.count_lobes()
                expected = self._end_expected(end)
                if progress and progress(self.paths_done - first, expected - first):
                    break
            self.count_lobes()
            self.device.queue.finish()
        finally:
            passed = time.perf_counter() - start
            self.seconds["render"] = self.seconds.get("render", 0.0) + passed
        return reached if self.target else self.paths_done == end

    def _end_expected(self, end: int) -> int:
        """Paths of the whole render, of which there are at most `end`."""
        return max(self.paths_done, min(end, self.plan.paths_needed)) if self.plan else end

    def _learn(self) -> None:
        """Set what is learned, if that is due after so many paths."""
        learning = self.setup.learning
        if learning and self.paths_done in learning.ends:
            _, variance, samples = self.film.read(self.memory)
            of_samples = variance.mean(axis=2, dtype=np.float64) * samples
            learning.update(float(of_samples.mean()), self.rays / self.paths_done)

    def _trace(self, wave: np.ndarray, n_pixels: int) -> None:
        """One wave, with paths of so many pixels, from the camera to the film.

        The host is one bounce ahead of the device: a bounce is launched over as many paths as the
        bounce before it began with, and the device, which knows better, never waits for the host.
        """
        stages = self.wavefront
        active = stages.generate(wave)
        self.rays += active
        lengths = None
        for depth in range(self.scene.render.max_depth + 1):
            stages.intersect_closest(wave, active)
            if depth == 0:
                stages.add_first_hits(wave, n_pixels)
            stages.shade_escaped(wave, active, depth)
            if depth < self.scene.render.max_depth:
                stages.scatter(wave, active, depth)
                stages.intersect_shadow(wave, active, depth)
            before, lengths = lengths, stages.swap()
            if before:
                active = self._count_rays(before)
                if not active:
                    break
        stages.learn(wave)
        stages.add_to_film(wave, n_pixels)
        if lengths:
            self._count_rays(lengths)

    def _count_rays(self, lengths: QueueLengths) -> int:
        """Count what a bounce met and the rays that it leads to; returns how many paths go on."""
        counts = lengths.wait()
        active, shadows = int(counts[layout.COUNT_NEXT]), int(counts[layout.COUNT_SHADOWS])
        self.rays += active + shadows
        self.shadow_rays += shadows
        hits = counts[layout.COUNT_HITS :]
        self.hits += int(hits.sum())
        self.material_hits += hits[: len(self.materials)]
        self.surface_hits += int(hits[len(self.materials) :].sum())
        self.misses += int(counts[layout.COUNT_MISSES])
        return active

    def count_lobes(self) -> None:
        """Take the counts of chosen lobes over from the device."""
        if self.features.statistics:
            for mine, read in zip(self.lobe_counts, self.wavefront.read_lobe_counts(), strict=True):
                mine += read
        self.lobes_are_counted()

    def lobes_are_counted(self) -> None:
        """The rays so far have their lobes in `lobe_counts`."""
        self._rays_with_lobes = self.rays

    def _next_wave(self, end: int) -> tuple[np.ndarray, int]:
        """The struct Wave of the paths from `paths_done` on, and the number of their pixels."""
        wave = self._wave.copy()
        wave["seed"] = self.scene.render.seed
        wave["held"] = self.held.word if self.held else 0
        spp = -(-end // self.n_pixels)
        learning = self.setup.learning
        if learning:
            end = learning.end_of_wave(self.paths_done, end)
            wave["recording"] = self.paths_done < learning.recorded
        left = end - self.paths_done  # for waves of one size: small ones take long for what they do
        n_paths = -(-left // -(-left // self.wave_size.paths))
        if self.plan:
            return wave, self.plan.cut(wave, n_paths, spp)
        before = self.first_sample * self.n_pixels + self.paths_done
        wave["first_sample"], wave["first_pixel"] = divmod(before, self.n_pixels)
        wave["n_paths"] = n_paths
        return wave, min(n_paths, self.n_pixels)

    def image(self) -> Image:
        """The picture so far, with its statistics; pixels without samples are 0."""
        mean, variance, samples = self.film.read(self.memory)
        empty = samples == 0
        if empty.any():
            mean[empty] = variance[empty] = 0.0
        layers = self.film.layers
        channels, attributes = layers.read(samples) if layers else ({}, {})
        stats = self.stats()
        stats["layers"] = sorted(channels)
        stats["error"] = None if empty.any() else estimated_errors(mean, variance)
        stats["samples"] = {"min": int(samples.min()), "max": int(samples.max())}
        stats["pixels_without_samples"] = int(empty.sum())
        return Image(
            rgb=mean,
            variance=variance if self.features.variance else None,
            stats=stats,
            exposure_stops=self.scene.film.exposure_stops,
            samples=samples,
            window=None if self.window.whole else self.window,
            layers=channels,
            attributes=attributes,
            transparent=self.features.transparent,
        )

    def stats(self) -> dict:
        """What `--stats` writes; times in seconds, sizes in bytes."""
        return statistics(self)


@showing_progress
def render(
    scene: Scene | str | os.PathLike,
    *,
    spp: int | None = None,
    seed: int | None = None,
    sampling: str | None = None,
    max_depth: int | None = None,
    device: str | Device | None = None,
    progress: Progress | bool | None = None,
    time_limit: float | None = None,
    target_rmse: float | None = None,
    target_relmse: float | None = None,
    wave_size: int | None = None,
    curves: Given = None,
    display: str | None = None,
    checkpoint: str | os.PathLike | None = None,
    checkpoint_minutes: float | None = None,
    resume: str | os.PathLike | None = None,
    samples: tuple[int, int] | None = None,
) -> Image:
    """Render a scene.

    Parameters
    ----------
    scene : Scene or path of a scene file
    spp, seed, sampling, max_depth      override those of the scene; spp is the mean over pixels
                                        where render.allocation is "adaptive"
    device : str or None                index or part of the name; None: FURCL_DEVICE, then the rule
    progress : callable, bool or None   called with (paths done, paths asked for) after every wave;
                                        stops the render by returning true. True shows a bar in
                                        notebooks and on terminals
    time_limit : float or None          stop between waves after this time [s]
    target_rmse : float or None         stop when the picture's estimated RMSE, of linear radiance,
                                        is about this; spp, if given, is then the most there may be
    target_relmse : float or None       the same of relMSE (furcl.image.compare)
    wave_size : int or None             paths traced together; changes no bit of the result; None:
                                        a constant of the kind of device
    curves : Curves, Grooms, Future or None     the scene's groom or grooms, where they are there or
                                        on their way
    display : str or None               HOST:PORT of a tev that shows the picture while it grows
    checkpoint : path or None           file that keeps the render where `progress` stops it, to
                                        go on from; with `checkpoint_minutes` also where it ends
    checkpoint_minutes : float or None  keep it so often too, against kills and power failures
    resume : path or None               go on from such a file, to the bits of a render that never
                                        stopped; spp may be larger than there where all pixels take
                                        the same number of samples
    samples : (first, end) or None      of every pixel only these of its samples, end not included:
                                        a part of a picture, for `furcl merge`; where all pixels
                                        take the same number, and in place of spp

    Returns
    -------
    Image       linear radiance, variance of the mean, samples, stats; stats["complete"] is false
                where the render was stopped before all samples were taken or the target, which
                is in stats["target"], was reached; stats["error"] has the errors as estimated

    Raises
    ------
    SceneError, GroomError, FibreError, DeviceError, ResourceError, KernelBuildError,
    CheckpointError
    """
    assert not isinstance(progress, bool)  # by showing_progress
    check_stops(progress, time_limit)
    check_checkpoints(checkpoint, checkpoint_minutes)
    check_samples(samples, spp)
    if display is not None:
        parse_address(display)
    saved = None if resume is None else read_header(resume)
    if not isinstance(scene, Scene):
        from furcl.scene.read import load_scene

        scene = load_scene(scene)
    target = Target.of(target_rmse, target_relmse)
    if target and spp is None:
        spp = MOST_SPP
    first, end = samples or (0, 0)
    spp = end - first if samples else spp
    scene = with_overrides(scene, spp=spp, seed=seed, sampling=sampling, max_depth=max_depth)
    renderer = Renderer(scene, device, wave_size, curves=curves, target=target)
    if first:
        renderer.restart(scene.render.seed, first)
    log.info(
        "%s",
        summary(renderer.material, renderer.memory.total_bytes, renderer.seconds["compile"]),
    )
    if saved:
        go_on(renderer, curves, saved)
    kept = None
    if checkpoint is not None:
        kept = Checkpoints(renderer, curves, checkpoint, checkpoint_minutes)
        progress = kept.watching(progress)
    shown = Shown(renderer, display) if display else None
    image = finished(renderer, shown.watching(progress) if shown else progress, time_limit)
    if shown:
        shown.end()
    if kept:
        kept.end()
    return image


def finished(
    renderer: Renderer, progress: Progress | None = None, time_limit: float | None = None
) -> Image:
    """The picture with all samples of its scene, or those that there are when it is stopped."""
    complete = renderer.advance(None, progress, time_limit)
    image = renderer.image()
    image.stats["complete"] = complete
    image.stats["target"] = renderer.target.as_dict() if renderer.target else None
    return image
