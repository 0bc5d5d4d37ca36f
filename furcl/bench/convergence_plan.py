"""What a convergence run renders, in which order, with which seeds."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from furcl.bench.convergence_variants import Variant
from furcl.errors import BenchError
from furcl.fibre import samplers
from furcl.scene.read import with_overrides
from furcl.scene.tables import Scene

SAMPLING = ("uniform-h", "attenuation-cdf", "full-cdf")
SPP = (64, 128, 256, 512)
RUNS = 5
REFERENCE_FACTOR = 16
MIN_RUNS = 2

# `--quick`: the same code on small pictures of thinned grooms.
QUICK_SIZE = (48, 48)
QUICK_SPP = (4, 8, 16)
QUICK_STRANDS = 3000


def quick_scene(scene: Scene, *, keep_size: bool = False) -> Scene:
    """A small picture of a scene; a generated groom is thinned to 3000 thicker strands."""
    changes = []
    table = msgspec.to_builtins(scene.curves)
    if table.get("n_strands", 0) > QUICK_STRANDS:
        radius = table["radius"] * math.sqrt(table["n_strands"] / QUICK_STRANDS)
        changes = [f"curves.n_strands={QUICK_STRANDS}", f"curves.radius={radius}"]
    return with_overrides(scene, changes, size=None if keep_size else QUICK_SIZE)


@dataclass(frozen=True, eq=False)
class Plan:
    """Scenes, variants and sample counts to compare.

    Attributes
    ----------
    scenes : tuple of Scene         with different names; their spp and seed are not used
    variants : tuple of Variant     what is compared; once the plan is made also those of `sampling`
    sampling : tuple of str         the short form: names of samplers, each a variant; those of
                                    furcl if left out and no variants are given
    baseline : str                  name of the variant that others are compared with; the first if
                                    left out
    spp : tuple of int              ascending, at least two
    runs : int                      independent renders of each, 5 or more for good intervals
    seed : int                      all seeds follow from it
    reference_spp : int             of the reference image; 0 for 16 times the largest of `spp`

    Raises
    ------
    BenchError      what shows nothing, and settings that a scene refuses
    SamplerError    a name of `sampling` that is not known
    """

    scenes: tuple[Scene, ...]
    variants: tuple[Variant, ...] = ()
    sampling: tuple[str, ...] | None = None
    baseline: str = ""
    spp: tuple[int, ...] = SPP
    runs: int = RUNS
    seed: int = 1
    reference_spp: int = 0

    def __post_init__(self) -> None:
        names = [scene.name for scene in self.scenes]
        if not names or len(set(names)) != len(names):
            raise BenchError(
                f"scenes {names}: one or more scenes with different names are needed; rename the "
                f"files or set `name`"
            )
        self._take_variants()
        if len(self.spp) < 2 or list(self.spp) != sorted(set(self.spp)) or self.spp[0] < 2:
            raise BenchError(
                f"spp {list(self.spp)}: two or more ascending numbers from 2 on are needed: the "
                f"slope and the variance follow from them"
            )
        if self.runs < MIN_RUNS:
            raise BenchError(
                f"runs = {self.runs}: at least {MIN_RUNS} are needed for an interval, 5 or more "
                f"for a good one"
            )
        if self.reference_spp == 0:
            object.__setattr__(self, "reference_spp", REFERENCE_FACTOR * self.spp[-1])
        if self.reference_spp < self.spp[-1]:
            raise BenchError(
                f"reference_spp = {self.reference_spp}: the reference needs at least as many "
                f"samples as the largest spp, {self.spp[-1]}; 16 times that is the default"
            )

    def _take_variants(self) -> None:
        short = self.sampling
        if short is None:
            short = () if self.variants else SAMPLING
        for name in short:
            samplers.find(name)
        variants = (*self.variants, *map(Variant.of_sampler, short))
        names = [variant.name for variant in variants]
        if not names or len(set(names)) != len(names):
            raise BenchError(f"variants {names}: one or more with different names are needed")
        if self.baseline and self.baseline not in names:
            raise BenchError(
                f"baseline {self.baseline!r}: no variant has that name; there are "
                f"{', '.join(names)}"
            )
        for scene in self.scenes:
            for variant in variants:
                variant.scene(scene)
        object.__setattr__(self, "sampling", short)
        object.__setattr__(self, "variants", variants)
        object.__setattr__(self, "baseline", self.baseline or names[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variants."""
        return tuple(variant.name for variant in self.variants)

    def renders(self) -> Iterator[tuple[int, int, str]]:
        """(run, spp, name of the variant) of one scene in the order of rendering.

        Variants take turns, A B C A B C, so that a machine that slows down hurts all alike.
        """
        for run in range(self.runs):
            for spp in self.spp:
                for name in self.names:
                    yield run, spp, name

    def samples_a_pixel(self) -> int:
        """Samples that every pixel of a scene gets in all measured renders."""
        return self.runs * sum(self.spp) * len(self.variants)

    def seed_of(self, *what: object) -> int:
        """The seed of one render: a hash of the plan's seed and what the render is."""
        return zlib.crc32("|".join(map(str, (self.seed, *what))).encode())
