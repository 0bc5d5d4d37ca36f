"""The stages as kernel launches: one method a stage, in the order in which a wave meets them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import pyopencl as cl

from furcl.bvh.build import Bvh, no_geometry, watch
from furcl.device import layout, program
from furcl.device.choice import Device
from furcl.device.features import Features
from furcl.device.index_checks import RECORD_BYTES, IndexChecks
from furcl.device.launch import (
    LOCAL_SIZE,
    Size,
    grid,
    path_defines,
    path_grid,
    ray_defines,
    ray_grid,
)
from furcl.device.memory import Memory, fill
from furcl.device.source import kernel_text
from furcl.fibre.material import FibreMaterial
from furcl.rendering.film import Film
from furcl.rendering.learning import Buffers

RAY_STAGES = ("intersect_closest", "intersect_shadow")
MATERIAL_STAGES = ("sample_lobe_h", "shade")
QUEUE_STAGES = ("generate", "shade_escaped", "sample_lobe_h", "shade", "shade_surface")


def stage_files(features: Features) -> dict[str, str]:
    """Kernel of each stage that a scene has -> its file."""
    files = {
        "generate": "stages/generate.cl",
        "intersect_closest": "stages/intersect.cl",
        "shade_escaped": "stages/shade_escaped.cl",
        "sample_lobe_h": "stages/sample_lobe_h.cl",
        "shade": "stages/shade.cl",
        "add_to_film": "stages/film.cl",
    }
    if getattr(features.layers, "of_first_hits", False):
        files["add_first_hits"] = "stages/first_hits.cl"
    if features.light_layers:
        files["add_light_layers"] = "stages/light_layers.cl"
    if features.has_surfaces:
        files["shade_surface"] = "stages/shade_surface.cl"
    if features.learning is not None:
        files["learn"] = "stages/learn.cl"
    if features.light_sampling:
        files["intersect_shadow"] = "stages/intersect.cl"
    return files


def stage_programs(features: Features) -> list[list[str]]:
    """Stages that are compiled together: every program costs a start some time, however small.

    Those of rays; those of the fibre's material, which have its features; the rest.
    """
    stages = list(stage_files(features))
    groups = (RAY_STAGES, MATERIAL_STAGES)
    rest = [s for s in stages if not any(s in group for group in groups)]
    return [*([s for s in stages if s in group] for group in groups), rest]


def stage_defines(stage: str, device: Device) -> dict[str, int]:
    """The launch sizes that a stage is built with, for a device."""
    return {**path_defines(device), **(ray_defines(device) if stage in RAY_STAGES else {})}


class Stage:
    """A kernel that is given only those arguments that changed since its last launch.

    Setting all arguments of a stage takes longer than launching it.
    """

    def __init__(self, kernel: cl.Kernel) -> None:
        self._kernel = kernel
        self.name: str = kernel.function_name
        self._bound: list[object] = [None] * kernel.num_args

    def launch(
        self, queue: cl.CommandQueue, size: tuple[int], local: tuple[int], *arguments
    ) -> cl.Event:
        """Start the kernel; arguments are told apart by identity, so none may be changed."""
        for i, argument in enumerate(arguments):
            if argument is not self._bound[i]:
                self._kernel.set_arg(i, argument)
                self._bound[i] = argument
        return cl.enqueue_nd_range_kernel(queue, self._kernel, size, local)


class QueueLengths:
    """Queue lengths on their way to the host."""

    def __init__(self, queue: cl.CommandQueue, buffer: cl.Buffer) -> None:
        self._counts = np.empty(buffer.size // 4, np.uint32)
        self._event = cl.enqueue_copy(queue, self._counts, buffer, is_blocking=False)
        queue.flush()

    def wait(self) -> np.ndarray:
        """The lengths (layout.COUNT_*), uint32; the last are those of the hit queues."""
        self._event.wait()
        return self._counts


class FibreStages:
    """The kernels of one fibre material and what they count.

    Attributes
    ----------
    material : FibreMaterial
    queue : np.uint32           number of its hit queue
    n_lobes : int
    lobe_counts : cl.Buffer     selections of each lobe
    stages : dict               name of a stage -> Stage
    """

    def __init__(self, memory: Memory, material: FibreMaterial, queue: int) -> None:
        self.material = material
        self.queue = np.uint32(queue)
        self.n_lobes = len(material.lobes)
        name = f"lobe counts: {queue}" if queue else "lobe counts"
        self.lobe_counts = memory.allocate(name, 4 * self.n_lobes, zero=True)
        self.stages: dict[str, Stage] = {}


class Wavefront:
    """Path state, queues and the kernels that work on them.

    Building one compiles the kernels and needs no tree; `place` gives it one.

    Parameters
    ----------
    features : Features             of the scene; the materials' kernels have their own
    materials : list                FibreMaterial each, in the order of their hit queues
    surface : struct or None        SurfaceParams, where the features have a surface
    shading : Buffer or None        of the meshes, where the features have some
    light : Buffer                  of furcl.device.index_checks.upload
    camera : struct Camera
    shutter : (n,) float32          furcl.rendering.shutter.shutter_words
    n_vertices : int                of the groom, for the index checks
    n_slots : int                   paths that can be traced together, at least

    Raises
    ------
    KernelBuildError    if a stage does not compile
    ResourceError       if the state does not fit the device
    KernelIndexError    from every stage of a debug build that uses an index outside its buffer
    """

    def __init__(
        self,
        memory: Memory,
        features: Features,
        materials: list[FibreMaterial],
        surface: np.ndarray | None,
        shading: cl.Buffer | None,
        light: cl.Buffer,
        camera: np.ndarray,
        shutter: np.ndarray,
        film: Film,
        n_vertices: int,
        n_slots: int,
    ) -> None:
        self.queue = memory.device.queue
        self.memory = memory
        self.features = features
        self.fibres = [FibreStages(memory, m, i) for i, m in enumerate(materials)]
        self.surface = [] if features.surface is None else [surface]
        self._shading = [] if features.meshes is None else [shading]
        self.light = light
        self.lamps = [light] if features.area_lamps else []
        self.film = film
        self._shutter: list[cl.Buffer] = []
        self.look(camera, shutter)
        n_slots = layout.whole_blocks(n_slots)
        self.n_slots = np.uint32(n_slots)
        self.events: dict[str, list[cl.Event]] = defaultdict(list)
        self.keep_events = False
        self._stages = self._build_stages()
        n_planes = len(layout.planes(features))
        self.checks = IndexChecks(self.queue, features)
        self.n_vertices = n_vertices
        record = RECORD_BYTES if features.debug else 0
        self.state = memory.allocate("path state", 4 * n_planes * n_slots + record)
        self.checks.watch(self.state, n_vertices=n_vertices, n_film=film.sums.size // 4)
        of_materials = (buffer for m in materials for buffer in (m.buffer, m.absorption))
        for buffer in (*of_materials, light):
            if buffer is not None:
                self.checks.watch(buffer)
        self.active, self.next, self.misses, self.shadows = (
            memory.allocate(f"queue {name}", 4 * n_slots)
            for name in ("active", "next", "misses", "shadows")
        )
        self.hits = memory.allocate("queues hits", 4 * n_slots * features.hit_queues)
        # Lengths of the active queue (of the bounce before) and of the queues being filled.
        n_counts = layout.COUNT_HITS + features.hit_queues
        self.active_counts, self.counts = (
            memory.allocate(f"queue lengths {name}", 4 * n_counts) for name in ("in", "out")
        )
        self.learning = None if features.learning is None else Buffers(memory, n_slots)
        self.geometry = no_geometry(memory, features.meshes is not None)
        self._starts = [self.geometry[0]] if features.fibres > 1 else []
        self._warm_up()

    def look(self, camera: np.ndarray, shutter: np.ndarray) -> None:
        """Set the struct Camera, and the words of the shutter where something moves."""
        self.camera = camera
        if self.features.motion or self.features.camera_motion:
            self._shutter = [self.memory.upload("shutter", shutter)]

    def _programs(self) -> list[tuple[FibreStages | None, list[str], Features]]:
        """What is compiled together: the material that has it to itself, stages, features."""
        found: list[tuple[FibreStages | None, list[str], Features]] = []
        for stages in stage_programs(self.features):
            if stages[0] in MATERIAL_STAGES:
                found += [(fibre, stages, fibre.material.features) for fibre in self.fibres]
            else:
                found.append((None, stages, self.features))
        return found

    def _source(
        self, stages: list[str], features: Features
    ) -> tuple[list[str], Features, dict[str, int]]:
        """What `program.build` and `kernel_text` take of stages that are compiled together."""
        files = stage_files(self.features)
        names = list(dict.fromkeys(files[stage] for stage in stages))
        return names, features, stage_defines(stages[0], self.memory.device)

    def texts(self) -> list[str]:
        """The texts of all stages as they are compiled."""
        sources = (self._source(stages, features) for _, stages, features in self._programs())
        return list(dict.fromkeys(kernel_text(*source) for source in sources))

    def _build_stages(self) -> dict[str, Stage]:
        """Compile the kernels; materials that need the same share a program."""
        kernels = {}
        for fibre, stages, features in self._programs():
            built = program.build(self.memory.device, *self._source(stages, features))
            of_stages = {stage: Stage(program.kernel_of(built, stage)) for stage in stages}
            if fibre is None:
                kernels |= of_stages
            else:
                fibre.stages = of_stages
        return kernels

    def place(self, bvh: Bvh, material_starts: Sequence[int] = ()) -> None:
        """Set the tree that rays are sent through.

        Parameters
        ----------
        bvh : Bvh                       with triangles where the features have meshes
        material_starts : (m,)          first vertex of the strands of each material
        """
        self.geometry = bvh.arguments()
        if self.features.fibres > 1:
            starts = np.array(material_starts[1:], np.uint32)
            self._starts = [self.memory.upload("material starts", starts)]
        if self.features.debug:
            watch(self.checks, bvh)

    @property
    def vertices(self) -> cl.Buffer:
        """The groom's vertices."""
        return self.geometry[1]

    @property
    def _corners(self) -> list[cl.Buffer]:
        """The corners of the meshes' triangles, where there are some."""
        return self.geometry[3:]

    def _warm_up(self) -> None:
        """Launch every stage over nothing, in the two grid sizes that runtimes compile for.

        CPU runtimes finish compiling a kernel when it is first launched; done here, that time
        does not count as rendering.
        """
        wave = np.zeros((), layout.struct_dtype("Wave"))
        wave["width"] = wave["height"] = wave["n_slots"] = 1
        for n in (LOCAL_SIZE, int(self.n_slots)):
            fill(self.queue, self.active_counts, 0, 4)
            self._launch_generate(wave, n)
            self.intersect_closest(wave, n)
            self.shade_escaped(wave, n, 0)
            self.scatter(wave, n, 0)
            self.intersect_shadow(wave, n, 0)
            self.add_first_hits(wave, n)
            self._launch_learn(wave, n)
            self._launch_film(wave, n)
        self.queue.finish()

    def generate(self, wave: np.ndarray) -> int:
        """Start the wave's paths; returns how many are active."""
        n = int(wave["n_paths"])
        fill(self.queue, self.active_counts, n, 4)
        self._launch_generate(wave, n)
        return n

    def _launch_generate(self, wave: np.ndarray, n: int) -> None:
        plan = [self.film.plan.plan] if self.film.plan else []
        camera = [self.camera, *plan, *self._shutter]
        self._launch("generate", n, self.state, self.active, wave, *camera)

    def intersect_closest(self, wave: np.ndarray, active: int) -> None:
        """Find what every active path meets next: fills the hit and miss queues.

        `active`, here and in the other stages, is at least the number of active paths; kernels
        read the number itself on the device.
        """
        fill(self.queue, self.counts, 0, self.counts.size)
        self._launch(
            "intersect_closest",
            active,
            self.state,
            self.active,
            self.hits,
            self.misses,
            self.active_counts,
            self.counts,
            self.n_slots,
            *self.geometry[:3],
            *self._starts,
            *self._corners,
            *self.surface,
            *self.lamps,
        )

    def add_first_hits(self, wave: np.ndarray, n_pixels: int) -> None:
        """Add what camera rays met to the layers of the film, if it has such."""
        layers = self.film.layers
        if layers and layers.first_hits:
            self._launch(
                "add_first_hits",
                n_pixels,
                self.state,
                layers.first_hits,
                wave,
                self.camera,
                *self.geometry[:3],
                *layers.first_hit_arguments(),
                *self.surface,
                *self._corners,
                *self._shading,
                *self.lamps,
                *([self.film.plan.plan] if self.film.plan else []),
                *(self._shutter if self.features.camera_motion else []),
            )

    def shade_escaped(self, wave: np.ndarray, active: int, depth: int) -> None:
        """Add the light to the paths that met nothing; they end."""
        self._launch(
            "shade_escaped",
            active,
            self.state,
            self.misses,
            self.counts,
            wave,
            self.light,
            *([np.uint32(depth)] if self.learning or self.features.transparent else []),
            *([self.learning.records] if self.learning else []),
        )

    def scatter(self, wave: np.ndarray, active: int, depth: int) -> None:
        """Continue the paths that met something, material by material."""
        for fibre in self.fibres:
            self.sample_lobe_h(fibre, wave, active, depth)
            self.shade(fibre, wave, active, depth)
        if self.features.has_surfaces:
            self.shade_surface(wave, active, depth)

    def sample_lobe_h(self, fibre: FibreStages, wave: np.ndarray, active: int, depth: int) -> None:
        """Choose lobe and offset for the paths that met a fibre of a material."""
        self._launch(
            fibre.stages["sample_lobe_h"],
            active,
            self.state,
            self.hits,
            self.counts,
            wave,
            np.uint32(depth),
            fibre.queue,
            self.vertices,
            fibre.material.buffer,
            fibre.lobe_counts,
            *self._absorption(fibre),
            *self._camera_of(fibre),
        )

    def _absorption(self, fibre: FibreStages) -> list[cl.Buffer]:
        """The absorption of a material's strands or points, and which vertices end strands."""
        values = fibre.material.absorption
        return [] if values is None else [values, self.geometry[2]]

    def _camera_of(self, fibre: FibreStages) -> list[np.ndarray]:
        """The camera, where a material asks for footprints of pixels."""
        return [self.camera] if fibre.material.features.mode == "multiscale" else []

    @property
    def _learned(self) -> list[cl.Buffer]:
        """What is learned, and the records to learn more."""
        return [self.learning.table, self.learning.records] if self.learning else []

    def shade(self, fibre: FibreStages, wave: np.ndarray, active: int, depth: int) -> None:
        """Continue the paths that met a fibre of a material: fills the next and shadow queues."""
        self._launch(
            fibre.stages["shade"],
            active,
            self.state,
            self.hits,
            self.next,
            self.shadows,
            self.counts,
            wave,
            np.uint32(depth),
            fibre.queue,
            self.vertices,
            fibre.material.buffer,
            self.light,
            *self._learned,
            *self._absorption(fibre),
            *(self._camera_of(fibre) if self.features.light_sampling else []),
        )

    def shade_surface(self, wave: np.ndarray, active: int, depth: int) -> None:
        """Continue the paths that met a surface: fills the next and shadow queues."""
        self._launch(
            "shade_surface",
            active,
            self.state,
            self.hits,
            self.next,
            self.shadows,
            self.counts,
            wave,
            np.uint32(depth),
            self.light,
            *self.surface,
            *self._corners,
            *self._shading,
            *self._learned,
        )

    def intersect_shadow(self, wave: np.ndarray, active: int, depth: int) -> None:
        """Add the light samples that nothing hides."""
        if self.features.light_sampling:
            self._launch(
                "intersect_shadow",
                active,
                self.state,
                self.shadows,
                self.counts,
                self.n_slots,
                *self.geometry,
                *self.surface,
                *self.lamps,
                *([np.uint32(depth)] if self.features.has_layer("lobes") else []),
            )

    def swap(self) -> QueueLengths:
        """Make the next queue the active one; the lengths of the bounce's queues are sent off."""
        lengths = QueueLengths(self.queue, self.counts)
        self.active, self.next = self.next, self.active
        self.active_counts, self.counts = self.counts, self.active_counts
        return lengths

    def learn(self, wave: np.ndarray) -> None:
        """Count what came back along the rays of finished paths, if they are recorded."""
        if wave["recording"]:
            self._launch_learn(wave, int(wave["n_paths"]))

    def _launch_learn(self, wave: np.ndarray, n: int) -> None:
        if self.learning:
            self._launch("learn", n, self.state, self.learning.records, self.learning.counts, wave)

    def add_to_film(self, wave: np.ndarray, n_pixels: int) -> None:
        """Add the wave's finished paths to the film, which belong to so many pixels."""
        self._launch_film(wave, n_pixels)

    def _launch_film(self, wave: np.ndarray, n: int) -> None:
        plan, layers = self.film.plan, self.film.layers
        if layers and layers.light:
            at = [plan.plan] if plan else []
            self._launch("add_light_layers", n, self.state, layers.light, wave, *at)
        planned = [plan.plan, plan.pilots, plan.n_levels] if plan else []
        self._launch(
            "add_to_film",
            n,
            self.state,
            self.film.sums,
            self.film.n_samples,
            self.film.nonfinite,
            wave,
            *planned,
        )

    def read_lobe_counts(self) -> list[np.ndarray]:
        """Selections of each lobe since the last call, (n_lobes,) int64 of each material; sets them
        to zero."""
        found = []
        for fibre in self.fibres:
            read = self.memory.read(fibre.lobe_counts, fibre.n_lobes, np.uint32)
            found.append(read.astype(np.int64))
            fill(self.queue, fibre.lobe_counts, 0, 4 * fibre.n_lobes)
        return found

    def _size(self, stage: str, n: int) -> Size:
        if stage in RAY_STAGES:
            return ray_grid(self.memory.device, n)
        if stage in QUEUE_STAGES:
            return path_grid(self.memory.device, n)
        return grid(n, local=LOCAL_SIZE)

    def _launch(self, stage: str | Stage, n: int, *arguments) -> None:
        """Launch a stage of the scene by its name, or one of a material, over n items."""
        kernel = self._stages[stage] if isinstance(stage, str) else stage
        size, local = self._size(kernel.name, n)
        event = kernel.launch(self.queue, size, local, *arguments)
        if self.keep_events:
            self.events[kernel.name].append(event)
        self.checks.check(kernel.name)
