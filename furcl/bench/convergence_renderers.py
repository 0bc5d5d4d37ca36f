"""The renderers of a scene's variants on one device, and what a run is told about them."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from furcl.bench.convergence_counter import Counter, StoppedError
from furcl.bench.convergence_variants import Variant, checks, chosen, settings_of
from furcl.device.choice import Device
from furcl.groom.joined import Grooms
from furcl.image.image import Image
from furcl.rendering.renderer import Progress, Renderer
from furcl.scene.digest import digest
from furcl.scene.tables import Scene


@dataclass(frozen=True)
class Render:
    """Independent samples that a variant is to take.

    Attributes
    ----------
    variant : Variant
    spp : int               samples a pixel
    seed : int
    number : int            tells those of a variant and of so many samples apart: the run, ...
    """

    variant: Variant
    spp: int
    seed: int
    number: int


@dataclass(frozen=True, eq=False)
class Rendered:
    """A render that is there.

    Attributes
    ----------
    image : Image
    seconds, cpu_seconds : float    wall time, and that of the process on all processors [s]
    worker : str or None            address of the worker of a cluster that rendered it
    """

    image: Image
    seconds: float
    cpu_seconds: float
    worker: str | None = None


@dataclass(frozen=True, eq=False)
class Facts:
    """What is known of a variant whose kernels are compiled.

    Attributes
    ----------
    setup : dict            as results.json says it (docs/convergence.md): settings, chosen,
                            compiled, checks and setup
    kernels : str           a hash of the texts of all stages
    light_sampling : bool   whether it samples the light
    device : texts          name, platform and version of the driver
    """

    setup: dict[str, Any]
    kernels: str
    light_sampling: bool
    device: tuple[str, str, str]

    def key(self, content: str) -> str:
        """A hash of all that its renders follow from but samples and seed.

        Parameters
        ----------
        content : str       `scene_digest` of the scene
        """
        return digest(content, self.setup["settings"], self.kernels, self.device)


class Sweep(Protocol):
    """Who renders the variants of a scene."""

    def facts(self, variants: Sequence[Variant]) -> list[Facts]:
        """What is known of variants, whose renderers are made for that."""
        ...

    def renders(
        self, blocks: Sequence[Sequence[Render]], *, count: bool = True, timed: bool = False
    ) -> Iterator[tuple[Render, Rendered]]:
        """Renders as they are ready; those of a block one after the other on one device.

        Parameters
        ----------
        count : bool        whether the samples are among those that progress tells of
        timed : bool        whether the times are results: then no render is begun twice

        Raises
        ------
        StoppedError        progress asked for the end
        """
        ...


class Renderers:
    """Makes the renderers of a scene's variants when they are asked for, and keeps them.

    Parameters
    ----------
    scene : Scene           without the settings of a variant
    grooms : Grooms         of the scene
    device : Device
    grown : float           that the grooms took to be made [s]
    """

    def __init__(self, scene: Scene, grooms: Grooms, device: Device, grown: float) -> None:
        self.scene, self.grooms, self.device, self.grown = scene, grooms, device, grown
        self._made: dict[Variant, tuple[Renderer, Facts]] = {}

    def facts(self, variant: Variant) -> Facts:
        """What is known of a variant."""
        return self._of(variant)[1]

    def render(self, render: Render, progress: Progress | None = None) -> Rendered | None:
        """A render; None where `progress` stopped it."""
        renderer = self._of(render.variant)[0]
        renderer.restart(render.seed)
        cpu = time.process_time()
        complete = renderer.advance(render.spp, progress)
        cpu = time.process_time() - cpu
        if not complete:
            return None
        return Rendered(_in_rows(renderer.image()), renderer.seconds["render"], cpu)

    def _of(self, variant: Variant) -> tuple[Renderer, Facts]:
        if variant not in self._made:
            self._made[variant] = self._make(variant)
        return self._made[variant]

    def _make(self, variant: Variant) -> tuple[Renderer, Facts]:
        """A renderer that has compiled all that its first render would."""
        own = variant.scene(self.scene)
        renderer = Renderer(own, self.device, curves=self.grooms)
        start = time.perf_counter()
        renderer.advance(1)
        first = time.perf_counter() - start
        found = chosen(own, renderer.features)
        setup = {
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
        device = (self.device.name, self.device.platform, self.device.driver_version)
        kernels = digest(*renderer.wavefront.texts())
        return renderer, Facts(setup, kernels, renderer.features.light_sampling, device)


def _in_rows(image: Image) -> Image:
    """A picture with its values in the order in which it would be sent: sums over it depend on the
    order."""
    variance = None if image.variance is None else np.ascontiguousarray(image.variance)
    return replace(image, rgb=np.ascontiguousarray(image.rgb), variance=variance)


class OneDevice:
    """A sweep by one device of this machine, in the order that is asked for."""

    def __init__(self, renderers: Renderers, counter: Counter) -> None:
        self._renderers, self._counter = renderers, counter

    def facts(self, variants: Sequence[Variant]) -> list[Facts]:
        """What is known of variants."""
        return [self._renderers.facts(variant) for variant in variants]

    def renders(
        self, blocks: Sequence[Sequence[Render]], *, count: bool = True, timed: bool = False
    ) -> Iterator[tuple[Render, Rendered]]:
        """Renders, one after the other; StoppedError as `Sweep`."""
        for block in blocks:
            for render in block:
                if self._counter.stopped:
                    raise StoppedError
                rendered = self._renderers.render(render, self._counter if count else None)
                if rendered is None:
                    raise StoppedError
                yield render, rendered
