"""A convergence run by the workers of a cluster.

A worker takes all variants of one run at one number of samples, in turn: a slow one slows them
alike, and a ratio of their times is of one machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

from furcl.bench.convergence_counter import Counter, StoppedError
from furcl.bench.convergence_renderers import Facts, Render, Rendered, Renderers
from furcl.bench.convergence_variants import Variant
from furcl.device.choice import Device
from furcl.distributed.job import Job
from furcl.distributed.tasks import Shared, Workers
from furcl.distributed.worker import address, made
from furcl.errors import BenchError
from furcl.groom.joined import Grooms
from furcl.scene.tables import Scene
from furcl.version import software


@dataclass(frozen=True, eq=False)
class _Work:
    """A scene, and the seconds that its grooms took to be made."""

    job: Job
    grown: float


@dataclass(frozen=True)
class _Block:
    """Renders for one worker, and of each the kernels that it must have."""

    renders: tuple[Render, ...]
    kernels: tuple[str, ...]


class Cluster:
    """A sweep by workers.

    Parameters
    ----------
    workers : Workers       of one kind
    counter : Counter
    variants : sequence     all that are asked for
    scene, grooms, grown    as for `Renderers`
    """

    def __init__(
        self,
        workers: Workers,
        counter: Counter,
        variants: Sequence[Variant],
        scene: Scene,
        grooms: Grooms,
        grown: float,
    ) -> None:
        self._name, self._counter = scene.name, counter
        job = Job.of(scene, grooms, [v.scene(scene).render.sampling for v in variants])
        self._shared = Shared(workers, _Work(job, grown))
        self._kernels: dict[Variant, str] = {}

    def facts(self, variants: Sequence[Variant]) -> list[Facts]:
        """What is known of variants; StoppedError as `Sweep`."""
        found = {}
        coming = self._shared.results(
            _facts, variants, lambda v: f"{self._name}, setting up {v.name}", idle=self._stopped
        )
        with closing(coming):
            for variant, facts in coming:
                found[variant] = facts
                self._kernels[variant] = facts.kernels
        if len(found) < len(variants):
            raise StoppedError
        return [found[variant] for variant in variants]

    def renders(
        self, blocks: Sequence[Sequence[Render]], *, count: bool = True, timed: bool = False
    ) -> Iterator[tuple[Render, Rendered]]:
        """Renders as they are ready, a block on one worker; StoppedError as `Sweep`.

        Raises
        ------
        BenchError      a worker with other kernels than that which set the variant up
        DeviceError     as `Shared`
        """
        items = [
            _Block(tuple(block), tuple(self._kernels[render.variant] for render in block))
            for block in blocks
        ]
        coming = self._shared.results(
            _rendered, items, self._said, twice=not timed, idle=self._stopped
        )
        n_left = len(items)
        with closing(coming):
            for block, rendered in coming:
                n_left -= 1
                for render, found in zip(block.renders, rendered, strict=True):
                    if count:
                        n_pixels = found.image.width * found.image.height
                        self._counter(render.spp * n_pixels, render.spp * n_pixels)
                    yield render, found
                if self._counter.stopped:
                    break
        if n_left:
            raise StoppedError

    def _stopped(self) -> bool:
        """Asked while nothing is ready."""
        return self._counter(0, 1)

    def _said(self, block: _Block) -> str:
        names = ", ".join(dict.fromkeys(render.variant.name for render in block.renders))
        return f"{self._name}, {block.renders[0].spp} samples a pixel of {names}"


def _renderers(device: Device, work: _Work) -> Renderers:
    def make(scene: Scene) -> Renderers:
        return Renderers(scene, work.job.grooms, device, work.grown)

    return made(work.job, make)


def _facts(device: Device, work: _Work, variant: Variant) -> Facts:
    """What is known of a variant, on a worker."""
    return _renderers(device, work).facts(variant)


def _rendered(device: Device, work: _Work, block: _Block) -> list[Rendered]:
    """The renders of a block one after the other, on a worker."""
    renderers, found = _renderers(device, work), []
    # All set-ups before the first clock starts.
    for render, kernels in zip(block.renders, block.kernels, strict=True):
        if renderers.facts(render.variant).kernels != kernels:
            raise BenchError(
                f"worker {address()}: its kernels of {render.variant.name} differ from those of "
                f"the worker that set the variant up; its furcl is "
                f"{' '.join(software().values())}: install the same furcl on all workers"
            )
    for render in block.renders:
        rendered = renderers.render(render)
        assert rendered is not None
        found.append(replace(rendered, worker=address()))
    return found
