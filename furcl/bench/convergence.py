"""Error against run time of variants of a scene, by independent renders against a reference.

The protocol is in docs/convergence.md. `run` renders what is missing in a folder and returns the
results; a run that was stopped goes on where it stopped.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from furcl.bench.convergence_plan import Plan
from furcl.bench.convergence_reference import (
    Reference,
    choose_variant,
    kernel_digest,
    reference_samples_left,
    render_reference,
)
from furcl.bench.convergence_results import assemble, scene_facts, write_results
from furcl.bench.convergence_state import State, name_of
from furcl.bench.convergence_variants import Variant, checks, chosen, settings_of
from furcl.device.choice import Device, open_device
from furcl.errors import BenchError
from furcl.fibre.samplers import BUILT_IN
from furcl.files import file_name
from furcl.image import compare
from furcl.image.image import Image
from furcl.rendering.renderer import Progress, Renderer
from furcl.scene.digest import digest, scene_digest
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)

STATE = "renders.json"
IMAGES = "images"


class _StoppedError(Exception):
    """The caller's progress function asked for the end."""


def run(
    plan: Plan,
    folder: str | Path,
    *,
    device: str | Device | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Render what `folder` does not hold yet, and compare.

    Parameters
    ----------
    plan : Plan
    folder : path           gets renders.json after every render, results.json and results.csv at
                            the end, and images/
    device : str, Device or None    as for `furcl.render`
    progress : callable or None     called with the path samples done and those of the whole run;
                                    stops the run by returning true: what is rendered is kept

    Returns
    -------
    dict        what results.json holds, see docs/convergence.md; "complete" is false where the run
                was stopped

    Raises
    ------
    BenchError      if the folder holds renders of other scenes, kernels or another device
    SceneError, GroomError, DeviceError, ResourceError, KernelBuildError, ImageError
    """
    folder = Path(folder)
    (folder / IMAGES).mkdir(parents=True, exist_ok=True)
    opened = device if isinstance(device, Device) else open_device(device)
    state = State(folder / STATE)
    state.check(plan)
    counter = _Counter(progress, plan)
    complete = True
    try:
        for scene in plan.scenes:
            _Bench(plan, scene, opened, folder, state, counter).run()
    except _StoppedError:
        complete = False
    results = assemble(plan, opened, state, complete=complete)
    write_results(results, folder)
    return results


class _Counter:
    """Path samples done, over all scenes, for the caller's progress function."""

    def __init__(self, progress: Progress | None, plan: Plan) -> None:
        self.progress = progress
        self.done = 0
        self.stopped = False
        self.total = sum(
            (plan.samples_a_pixel() + plan.reference_spp) * s.film.width * s.film.height
            for s in plan.scenes
        )

    def forget(self, samples: int) -> None:
        """Take out of the total what need not be rendered."""
        self.total -= samples

    def __call__(self, done: int, total: int) -> bool:
        if self.progress is not None and self.progress(self.done + done, self.total):
            self.stopped = True
        if done == total:
            self.done += total
        return self.stopped


class _Bench:
    """One scene of a plan."""

    def __init__(
        self,
        plan: Plan,
        scene: Scene,
        device: Device,
        folder: Path,
        state: State,
        counter: _Counter,
    ) -> None:
        self.plan, self.scene, self.device = plan, scene, device
        self.folder, self.state, self.counter = folder, state, counter
        self.n_pixels = scene.film.width * scene.film.height
        self.file = file_name(scene.name)

    def run(self) -> None:
        """Render everything that is missing."""
        content = scene_digest(self.scene)
        start = time.perf_counter()
        self.grooms = self.scene.build_grooms()
        self.grown = time.perf_counter() - start
        renderers = {variant.name: self._renderer(variant) for variant in self.plan.variants}
        keys = {name: self._key(content, r) for name, r in renderers.items()}
        self._check_keys(keys)
        reference = self._reference(content, renderers)
        for run, spp, name in self._missing():
            record, image = self._measure(renderers[name], reference, run, spp, name)
            if run == 0:
                image.save(self.folder / IMAGES / f"{self.file}-{file_name(name)}-{spp}.exr")
            self.state.add(self.scene.name, name, spp, run, record)
            log.debug(
                "%s, %s, %d spp, run %d: %.2f s, RMSE %.4g", self.scene.name, name, spp, run,
                record["seconds"], record["rmse"],
            )  # fmt: skip

    def _renderer(self, variant: Variant) -> Renderer:
        """A renderer that has compiled all that its first render would."""
        own = variant.scene(self.scene)
        renderer = Renderer(own, self.device, curves=self.grooms)
        start = time.perf_counter()
        renderer.advance(1)
        first = time.perf_counter() - start
        found = chosen(own, renderer.features)
        self.state.data["setup"][name_of(self.scene.name, variant.name)] = {
            "settings": settings_of(own),
            "chosen": found,
            "compiled": json.loads(json.dumps(renderer.stats()["features"]["compiled"])),
            "checks": checks(self.scene, own, found),
            "setup": {
                "curves": self.grown,
                **{name: renderer.seconds[name] for name in ("bvh", "tables", "compile")},
                "first_sample": first,
                "bytes": renderer.stats()["bytes"],
            },
        }
        return renderer

    def _key(self, content: str, renderer: Renderer) -> str:
        device = (self.device.name, self.device.platform, self.device.driver_version)
        return digest(content, settings_of(renderer.scene), kernel_digest(renderer), device)

    def _check_keys(self, keys: Mapping[str, str]) -> None:
        for name, key in keys.items():
            for record in self.state.of_variant(self.scene.name, name).values():
                if record["key"] != key:
                    raise BenchError(
                        f"{self.state.path}: holds renders of {self.scene.name} by {name} with "
                        f"another scene, size, settings, device or version of the kernels; "
                        f"continue with what it was begun with, or give another folder"
                    )
        self.keys = keys

    def _missing(self) -> Iterator[tuple[int, int, str]]:
        todo = []
        there = {name: self.state.of_variant(self.scene.name, name) for name in self.plan.names}
        for run, spp, name in self.plan.renders():
            if (spp, run) in there[name]:
                self.counter.forget(spp * self.n_pixels)
            else:
                todo.append((run, spp, name))
        yield from todo

    def _render_once(
        self, renderer: Renderer, seed: int, spp: int, *, count: bool = True
    ) -> tuple[Image, float, float]:
        """Independent samples of a seed: image, wall seconds, CPU seconds of this process."""
        if self.counter.stopped:
            raise _StoppedError
        renderer.restart(seed)
        cpu = time.process_time()
        complete = renderer.advance(spp, self.counter if count else None)
        cpu = time.process_time() - cpu
        if not complete:
            raise _StoppedError
        return renderer.image(), renderer.seconds["render"], cpu

    def _reference(self, content: str, renderers: Mapping[str, Renderer]) -> Reference:
        name, figures = choose_variant(
            {name: r for name, r in renderers.items() if self._may_be_reference(name, r)},
            self.plan.seed_of,
            lambda renderer, seed, spp: self._render_once(renderer, seed, spp, count=False),
        )
        if name is None:
            name, chosen_one = "full-cdf", self._renderer(Variant.of_sampler("full-cdf"))
        else:
            chosen_one = renderers[name]
        arguments = (chosen_one, content, self.plan.reference_spp, self.plan.seed_of)
        left = reference_samples_left(*arguments)
        self.counter.forget((self.plan.reference_spp - left) * self.n_pixels)
        reference = render_reference(*arguments, self._render_once)
        reference.image.save(self.folder / IMAGES / f"{self.file}-reference.exr")
        self.state.data["scenes"][self.scene.name] = {
            **scene_facts(self.scene, self.grooms.curves),
            "reference": {"variant": name, **reference.facts, "pilot": figures},
        }
        return reference

    def _may_be_reference(self, name: str, renderer: Renderer) -> bool:
        """Samplers of the user's may be wrong, and other settings may show another picture."""
        facts = self.state.data["setup"][name_of(self.scene.name, name)]
        return renderer.scene.render.sampling in BUILT_IN and facts["checks"]["mean"] is None

    def _measure(
        self, renderer: Renderer, reference: Reference, run: int, spp: int, name: str
    ) -> tuple[dict[str, Any], Image]:
        """One render and its errors."""
        seed = self.plan.seed_of(self.scene.name, name, spp, run)
        image, seconds, cpu_seconds = self._render_once(renderer, seed, spp)
        truth = reference.image.rgb
        weight = 1.0 / (truth.astype(np.float64) ** 2 + compare.REL_EPSILON)
        raw = compare.rmse(image.rgb, truth) ** 2
        mse = raw - float(reference.variance.mean())
        stats = image.stats
        own = image.variance if renderer.scene.render.variance else None
        record = {
            "key": self.keys[name],
            "seed": seed,
            "seconds": seconds,
            "cpu_seconds": cpu_seconds,
            "mse_against_reference": raw,
            "mse": mse,
            "rmse": float(np.sqrt(max(mse, 0.0))),
            "relmse": compare.relmse(image.rgb, truth)
            - float((reference.variance * weight).mean()),
            "flip": compare.flip(image.rgb, truth),
            "variance": None if own is None else float(own.astype(np.float64).mean()),
            "mean": float(image.rgb.astype(np.float64).mean()),
            "rays": stats["rays"],
            "paths": stats["paths"],
            "path_length": stats["path_length"],
            "hits_per_path": stats["hits_per_path"],
            "lobes": stats["lobes"],
            "nonfinite": stats["nonfinite"],
        }
        return record, image
