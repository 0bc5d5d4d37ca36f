"""A small render by a platform that takes its time, beside the same on another device:

python bench/small_render.py CASE PLATFORM

Tables, such as those of attenuations, are made by the other device. Prints, as a line of JSON, what
was rendered and both means. bench/oclgrind_check.py starts this in processes where oclgrind, a
simulated GPU, is a platform.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl

from furcl.bench.variants import FIBRE_VALUES, VALUES
from furcl.device.choice import Device, list_candidates, open_candidate
from furcl.rendering import setup
from furcl.rendering.renderer import Renderer
from furcl.rendering.wavefront import stage_files
from furcl.scene.read import load_scene
from furcl.scene.tables import Scene

SIZE, SPP, WAVE_SIZE = "4x4", 4, 32

#: Of every case: short paths. Of grooms: few fibres, and thick, so that a few samples meet some.
SMALL = (f"render.spp={SPP}", "render.max_depth=3")
FEW_HAIRS = ("curves.n_strands=12", "curves.radius=0.12")
THICK_FUR = ("curves.n_strands=40", "curves.radius=0.15")
TETRAHEDRON = """\
v 0 0 1
v 1 0 -0.4
v -0.6 0.9 -0.4
v -0.6 -0.9 -0.4
f 1 2 3
f 1 3 4
f 1 4 2
f 2 4 3
"""

#: Case -> scene and what is set of it; FOLDER is where the mesh is.
CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "conventional": (
        "single_fibre",
        ("fibre.kappa=0", "fibre.sigma_ca=0.5", "fibre.layers=0.5", "fibre.alpha_deg=0",
         "render.variance=false", "render.sampling=uniform-h", "film.filter=box",
         "render.sequence=independent", "render.light_sampling=bcsdf", "render.roulette=depth",
         "render.roulette_depth=1"),
    ),
    "sky": ("black_hair", (*FEW_HAIRS, "camera.aperture_radius=0.1", "film.crop=[1, 1, 3, 4]")),
    "adaptive": (
        "raccoon",
        (*THICK_FUR, "render.allocation=adaptive", "render.sampling=attenuation-cdf",
         "film.layers=['alpha', 'depth', 'strand', 'groom', 'lobes', 'direct', 'samples']",
         "film.background=transparent"),
    ),
    "simulated": (
        "red_fox",
        (*THICK_FUR, "fibre.scattering=simulated", "render.sampling=all-lobes",
         "film.filter=tent", "render.roulette=throughput", "render.roulette_depth=1"),
    ),
    "near": (
        "white_hair",
        (*FEW_HAIRS, "fibre.mode=near", 'camera={projection="orthographic"}'),
    ),
    "multiscale": ("white_hair", (*FEW_HAIRS, "fibre.mode=multiscale")),
    "grooms": (
        "two_grooms",
        ("groom.scalp.curves.n_strands=12", "groom.scalp.curves.radius=0.12",
         "groom.streaks.curves.n_strands=6", "groom.streaks.curves.n_clumps=2",
         "groom.streaks.curves.radius=0.12"),
    ),
    "lamps": ("lamps", FEW_HAIRS),
    "motion": (
        "motion",
        ("groom.rolling.curves.n_strands=20", "groom.rolling.curves.radius=0.15",
         "groom.standing.curves.n_strands=20", "groom.standing.curves.radius=0.15"),
    ),
    "mesh": (
        "portrait",
        (*FEW_HAIRS, 'mesh.head.file="FOLDER/tetrahedron.obj"', "mesh.head.coat={}"),
    ),
    **{
        model: ("black_hair", (*FEW_HAIRS, f'fibre={{model="{model}", preset="{preset}"}}'))
        for model, preset in (
            ("chiang", "brown"), ("deon", "brown"), ("marschner", "brown"),
            ("sadeghi", "production"), ("yan2015", "human-white"),
        )
    },
}  # fmt: skip

#: Not renders but kernels: one that races and one that writes beyond its buffer, on purpose, and
#: one that reads what was filled, which is initialised.
RACE, BEYOND, FILLED = "race", "beyond", "filled"
KERNELS = {
    RACE: "x[0] = (float)get_global_id(0);",
    BEYOND: "x[get_global_id(0) + 1] = 1.0f;",
    FILLED: "if (x[get_global_id(0)] > 0.0f) x[get_global_id(0)] = 1.0f;",
}

Report = dict[str, Any]


class _InTurn:
    """A pool that does its work at once: oclgrind takes the commands of one thread alone."""

    def __init__(self, max_workers: int) -> None:
        del max_workers

    def __enter__(self) -> _InTurn:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(work(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


class _MadeElsewhere:
    """A memory whose tables another device makes; the buffers are its own."""

    def __init__(self, memory: Any, device: Device) -> None:
        self._memory, self.device = memory, device

    def __getattr__(self, name: str) -> Any:
        return getattr(self._memory, name)


def _devices(platform: str) -> tuple[Device, Device]:
    """The device of the platform, and the first of the others."""
    candidates = list_candidates()
    (of_platform,) = [c for c in candidates if c.runtime == platform]
    other = next(c for c in candidates if c.runtime != platform)
    return open_candidate(of_platform), open_candidate(other)


def _values(scene: Scene, renderer: Renderer) -> dict[str, list[str]]:
    """What each field of the compile matrix is, of all materials."""
    values: dict[str, set[str]] = {field: set() for field in VALUES}
    for material in renderer.setup.materials:
        for field, had in values.items():
            of = material.features.fibre if field in FIBRE_VALUES else material.features
            had.add(repr(getattr(of, field, None)))
    light = scene.environment
    values["light"] = {repr(light and type(light).__struct_config__.tag)}
    values["sampler"] = {repr(scene.render.sampling)}
    return {field: sorted(had) for field, had in values.items()}


def render_case(name: str, platform: str) -> Report:
    """Render a case on a platform, its tables made by another device, and then on that."""
    device, other = _devices(platform)
    build_material = setup.build_material
    setup.ThreadPoolExecutor = _InTurn  # pyright: ignore[reportAttributeAccessIssue]
    setup.build_material = lambda memory, *rest, **named: build_material(
        _MadeElsewhere(memory, other),  # pyright: ignore[reportArgumentType]
        *rest,
        **named,
    )
    of, settings = CASES[name]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "tetrahedron.obj").write_text(TETRAHEDRON)
        overrides = [setting.replace("FOLDER", folder) for setting in (*settings, *SMALL)]
        scene = load_scene(of, overrides=overrides, size=SIZE)
        renderer = Renderer(scene, device, wave_size=WAVE_SIZE)
        renderer.advance(SPP)
        image = renderer.image()
        there = Renderer(scene, other, wave_size=WAVE_SIZE)
        there.advance(SPP)
    return {
        "stages": sorted(stage_files(renderer.features)),
        "values": _values(scene, renderer),
        "hits": float(image.stats["hits_per_path"]),
        "mean": float(np.mean(image.rgb, dtype=np.float64)),
        "mean_elsewhere": float(np.mean(there.image().rgb, dtype=np.float64)),
    }


def run_kernel(name: str, platform: str) -> Report:
    """Run a kernel of KERNELS over a buffer of as many values as items, which was filled."""
    (found,) = [p for p in cl.get_platforms() if p.name == platform]
    context = cl.Context(found.get_devices())
    queue = cl.CommandQueue(context)
    buffer = cl.Buffer(context, cl.mem_flags.READ_WRITE, 256)
    cl.enqueue_fill_buffer(queue, buffer, np.zeros(1, np.float32), 0, 256)
    text = f"__kernel void {name}(__global float* x) {{ {KERNELS[name]} }}"
    cl.Kernel(cl.Program(context, text).build(), name)(queue, (64,), (64,), buffer)
    queue.finish()
    return {}


if __name__ == "__main__":
    wanted, where = sys.argv[1:]
    work = run_kernel if wanted in KERNELS else render_case
    print(json.dumps(work(wanted, where)))
