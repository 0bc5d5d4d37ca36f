"""Error against run time of variants of a scene, by independent renders against a reference.

The protocol is in docs/convergence.md. `run` renders what is missing in a folder and returns the
results; a run that was stopped goes on where it stopped.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from furcl.bench.convergence_cluster import Cluster
from furcl.bench.convergence_counter import Counter, StoppedError
from furcl.bench.convergence_plan import Plan
from furcl.bench.convergence_reference import Parts, Reference, choose_variant
from furcl.bench.convergence_renderers import (
    Facts,
    OneDevice,
    Render,
    Rendered,
    Renderers,
    Sweep,
)
from furcl.bench.convergence_results import assemble, scene_facts, write_results
from furcl.bench.convergence_state import State, name_of
from furcl.bench.convergence_variants import Variant
from furcl.bench.record import circumstances
from furcl.bench.workers import workers_of
from furcl.device.choice import Device, open_device
from furcl.errors import BenchError
from furcl.fibre.samplers import BUILT_IN
from furcl.files import file_name
from furcl.groom.joined import Grooms
from furcl.image import compare
from furcl.rendering.renderer import Progress
from furcl.scene.digest import scene_digest
from furcl.scene.tables import Scene

if TYPE_CHECKING:
    from distributed import Client

log = logging.getLogger(__name__)

STATE = "renders.json"
IMAGES = "images"


def run(
    plan: Plan,
    folder: str | Path,
    *,
    device: str | Device | None = None,
    progress: Progress | None = None,
    client: Client | str | None = None,
) -> dict[str, Any]:
    """Render what `folder` does not hold yet, and compare.

    Parameters
    ----------
    plan : Plan
    folder : path           gets renders.json after every render, results.json and results.csv at
                            the end, and images/
    device : str, Device or None    as for `furcl.render`; with `client` on each worker, and no
                                    Device
    progress : callable or None     called with the path samples done and those of the whole run;
                                    stops the run by returning true: what is rendered is kept
    client : Client, text or None   of a Dask cluster whose workers render, or the address of its
                                    scheduler: each takes all variants of one run at one number of
                                    samples. All that is found but times is as with one device

    Returns
    -------
    dict        what results.json holds, see docs/convergence.md; "complete" is false where the run
                was stopped

    Raises
    ------
    BenchError      if the folder holds renders of other scenes, kernels or another device
    DeviceError     no device; with `client` also as `furcl.distributed.render`, and for workers
                    whose devices or drivers differ
    SceneError, GroomError, ResourceError, KernelBuildError, ImageError
    """
    folder = Path(folder)
    (folder / IMAGES).mkdir(parents=True, exist_ok=True)
    state = State(folder / STATE)
    state.check(plan)
    counter = Counter(progress, plan)
    complete = True
    with _renderers(plan, device, client, counter) as (where, sweep_of):
        try:
            for scene in plan.scenes:
                _Bench(plan, scene, folder, state, counter).run(sweep_of)
        except StoppedError:
            complete = False
    if state.data["workers"]:
        where = {**where, "workers": len(state.data["workers"])}
    results = assemble(plan, where, state, complete=complete)
    write_results(results, folder)
    return results


SweepOf = Callable[[Scene, Grooms, float], Sweep]
"""Who renders a scene with these grooms, which took so many seconds to be made."""


@contextmanager
def _renderers(
    plan: Plan, device: str | Device | None, client: Client | str | None, counter: Counter
) -> Iterator[tuple[dict[str, Any], SweepOf]]:
    """Where a run renders, as JSON values, and who."""
    if client is None:
        opened = device if isinstance(device, Device) else open_device(device)
        yield circumstances(opened), partial(_on_one, opened, counter)
        return
    with workers_of(client, device) as (workers, where):
        yield where, partial(Cluster, workers, counter, plan.variants)


def _on_one(
    device: Device, counter: Counter, scene: Scene, grooms: Grooms, grown: float
) -> OneDevice:
    return OneDevice(Renderers(scene, grooms, device, grown), counter)


class _Bench:
    """One scene of a plan."""

    def __init__(
        self, plan: Plan, scene: Scene, folder: Path, state: State, counter: Counter
    ) -> None:
        self.plan, self.scene = plan, scene
        self.folder, self.state, self.counter = folder, state, counter
        self.n_pixels = scene.film.width * scene.film.height
        self.file = file_name(scene.name)

    def run(self, sweep_of: SweepOf) -> None:
        """Render everything that is missing."""
        start = time.perf_counter()
        grooms = self.scene.build_grooms()
        sweep = sweep_of(self.scene, grooms, time.perf_counter() - start)
        content = scene_digest(self.scene, grooms)
        variants = self.plan.variants
        facts = dict(zip(variants, sweep.facts(variants), strict=True))
        for variant, found in facts.items():
            self.state.data["setup"][name_of(self.scene.name, variant.name)] = found.setup
        self.keys = {variant: found.key(content) for variant, found in facts.items()}
        self._check_keys()
        reference = self._reference(sweep, content, grooms, facts)
        for render, rendered in sweep.renders(self._missing(), timed=True):
            name, spp, run = render.variant.name, render.spp, render.number
            record = self._record(reference, render, rendered)
            if run == 0:
                path = self.folder / IMAGES / f"{self.file}-{file_name(name)}-{spp}.exr"
                rendered.image.save(path)
            self.state.add(self.scene.name, name, spp, run, record, rendered.worker)
            log.debug(
                "%s, %s, %d spp, run %d: %.2f s, RMSE %.4g", self.scene.name, name, spp, run,
                record["seconds"], record["rmse"],
            )  # fmt: skip

    def _check_keys(self) -> None:
        for variant, key in self.keys.items():
            for record in self.state.of_variant(self.scene.name, variant.name).values():
                if record["key"] != key:
                    raise BenchError(
                        f"{self.state.path}: holds renders of {self.scene.name} by "
                        f"{variant.name} with another scene, size, settings, device or version of "
                        f"the kernels; continue with what it was begun with, or give another folder"
                    )

    def _missing(self) -> list[list[Render]]:
        """What is still to be rendered; the variants of a run and a number of samples together."""
        blocks: dict[tuple[int, int], list[Render]] = {}
        there = {v: self.state.of_variant(self.scene.name, v.name) for v in self.plan.variants}
        named = {variant.name: variant for variant in self.plan.variants}
        for run, spp, name in self.plan.renders():
            if (spp, run) in there[named[name]]:
                self.counter.forget(spp * self.n_pixels)
                continue
            seed = self.plan.seed_of(self.scene.name, name, spp, run)
            blocks.setdefault((run, spp), []).append(Render(named[name], spp, seed, run))
        return list(blocks.values())

    def _reference(
        self, sweep: Sweep, content: str, grooms: Grooms, facts: Mapping[Variant, Facts]
    ) -> Reference:
        may = {v: f for v, f in facts.items() if self._may_be_reference(v, f)}
        variant, figures = choose_variant(may, self.plan.seed_of, sweep)
        if variant is None:
            variant = Variant.of_sampler("full-cdf")
            (found,) = sweep.facts([variant])
        else:
            found = facts[variant]
        own, spp = variant.scene(self.scene), self.plan.reference_spp
        parts = Parts(variant, own, found, content, spp, self.plan.seed_of)
        left = sum(part.spp for part in parts.missing)
        self.counter.forget((spp - left) * self.n_pixels)
        for render, rendered in sweep.renders([[part] for part in parts.missing]):
            parts.add(render.number, rendered)
        reference = parts.reference()
        reference.image.save(self.folder / IMAGES / f"{self.file}-reference.exr")
        self.state.data["scenes"][self.scene.name] = {
            **scene_facts(self.scene, grooms.curves),
            "reference": {"variant": variant.name, **reference.facts, "pilot": figures},
        }
        return reference

    def _may_be_reference(self, variant: Variant, facts: Facts) -> bool:
        """Samplers of the user's may be wrong, and other settings may show another picture."""
        sampling = variant.scene(self.scene).render.sampling
        return sampling in BUILT_IN and facts.setup["checks"]["mean"] is None

    def _record(self, reference: Reference, render: Render, rendered: Rendered) -> dict[str, Any]:
        """What is kept of a render: its cost and its errors."""
        image, truth = rendered.image, reference.image.rgb
        weight = 1.0 / (truth.astype(np.float64) ** 2 + compare.REL_EPSILON)
        raw = compare.rmse(image.rgb, truth) ** 2
        mse = raw - float(reference.variance.mean())
        stats = image.stats
        own = image.variance if render.variant.scene(self.scene).render.variance else None
        return {
            "key": self.keys[render.variant],
            "seed": render.seed,
            "seconds": rendered.seconds,
            "cpu_seconds": rendered.cpu_seconds,
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
