"""Whether every variant of the ladder shows the picture of the baseline: means of 64 blocks.

python bench/unbiased.py [LIGHT...] [--scenes black_hair,raccoon] [--size 48x48] [--runs 16]
    [--spp 16] [--reference-spp 64] [--device TEXT] [-o FILE.json] [--scaled 1.02]

Every variant, and the reference, which is the ladder's baseline, is rendered --runs times, with
seeds of its own. Each block of the picture and the whole of it are compared by Welch's t test over
the runs, as samples of one render may depend on each other. All tests of all variants, scenes and
lights are one family (Bonferroni, ALPHA in all). In lights of which BCSDF samples find a part by
rare chance (BY_CHANCE) means of runs are not normal: there the reference samples the light, and
variants that do not are left out. --scaled is the mutant: the variants' pictures times a factor.
Ends with 1 where a test fails.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import ladder
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from furcl.bench.convergence_variants import Variant
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene

ALPHA = 1e-3
FLOAT32 = 2.0**-22  # relative rounding of a pixel's mean
N_BLOCKS = 8  # along each side
BY_CHANCE = ("sun", "studio", "sunrise")

Array = NDArray[np.float64]


def blocks(picture: NDArray[Any]) -> Array:
    """Means of 8 x 8 blocks and of the whole of a picture, (65,), over pixels and channels.

    Rows and columns are split as evenly as they can be; sides are at least 8.
    """
    values = picture.astype(np.float64).mean(axis=2)
    rows = np.array_split(values, N_BLOCKS, axis=0)
    cells = [cell.mean() for row in rows for cell in np.array_split(row, N_BLOCKS, axis=1)]
    return np.array([*cells, values.mean()])


def z_scores(variant: Array, reference: Array) -> Array:
    """Differences of means in standard deviations of a normal variable of the same chance, by
    Welch's t test.

    Parameters
    ----------
    variant, reference : (runs, n)      independent runs; where they have no noise, differences are
                                        measured in roundings of float32
    """
    a, b = (x.var(axis=0, ddof=1) / len(x) for x in (variant, reference))
    difference = variant.mean(axis=0) - reference.mean(axis=0)
    rounding = FLOAT32 * np.abs(reference.mean(axis=0))
    t = difference / np.sqrt(np.maximum(a + b + rounding**2, 1e-300))
    square = a**2 / (len(variant) - 1) + b**2 / (len(reference) - 1)
    freedom = np.where(square > 0.0, (a + b) ** 2 / np.maximum(square, 1e-300), np.inf)
    p = stats.t.sf(np.abs(t), np.minimum(freedom, 1e6))
    return np.copysign(stats.norm.isf(np.maximum(p, 1e-300)), difference)


def bound(n_tests: int, alpha: float = ALPHA) -> float:
    """|z| that one of n_tests or more exceed with chance alpha at most, if nothing is biased."""
    return float(stats.norm.isf(0.5 * alpha / n_tests))


@dataclass(frozen=True)
class Result:
    """One variant in one scene and light: largest |z| of the blocks, and z of the whole."""

    light: str
    scene: str
    variant: str
    blocks: float
    whole: float
    relative: float
    error: float

    @property
    def largest(self) -> float:
        """Largest |z|."""
        return max(self.blocks, abs(self.whole))


def means(renderer: Renderer, name: str, runs: int, spp: int, scale: float = 1.0) -> Array:
    """(runs, 65) block means of independent renders, with seeds of that name."""
    found = []
    for run in range(runs):
        renderer.restart(zlib.crc32(f"{renderer.scene.name}|{name}|{run}".encode()))
        renderer.advance(spp)
        found.append(scale * blocks(renderer.image().rgb))
    return np.array(found)


def compare(
    scene: Scene,
    light: str,
    variants: Iterable[Variant],
    reference: Variant,
    device: Device,
    *,
    runs: int,
    spp: int,
    reference_spp: int,
    scale: float = 1.0,
) -> list[Result]:
    """All variants of a scene against the reference, which is rendered once."""
    curves = scene.build_curves()
    truth_renderer = Renderer(reference.scene(scene), device, curves=curves)
    truth = means(truth_renderer, "the reference", runs, reference_spp)
    found = []
    for variant in variants:
        renderer = Renderer(variant.scene(scene), device, curves=curves)
        if light in BY_CHANCE and not renderer.features.light_sampling:
            continue
        mine = means(renderer, variant.name, runs, spp, scale)
        z = z_scores(mine, truth)
        level = truth[:, -1].mean()
        spread = np.hypot(mine[:, -1].std(ddof=1), truth[:, -1].std(ddof=1)) / np.sqrt(runs)
        found.append(
            Result(
                light,
                scene.name,
                variant.name,
                float(np.abs(z[:-1]).max()),
                float(z[-1]),
                float(mine[:, -1].mean() / level - 1.0),
                float(spread / level),
            )
        )
    return found


def verdict(results: list[Result]) -> tuple[float, list[Result]]:
    """The bound of the family, and those that exceed it."""
    limit = bound(len(results) * (N_BLOCKS**2 + 1)) if results else np.inf
    return limit, [result for result in results if result.largest > limit]


def reference_of(light: str) -> Variant:
    """The baseline; where chance finds the light too rarely, with light samples."""
    base, _, _ = ladder.known_steps()
    if light in BY_CHANCE:
        base = {**base, "light_sampling": "mis"}
    return Variant.parse(f"reference: {' '.join(f'{k}={v}' for k, v in base.items())}")


def run(options: argparse.Namespace) -> int:
    """Measure, print a line each, write, and say whether all is well."""
    device = open_device(options.device)
    results: list[Result] = []
    for light in options.lights or ladder.LIGHTS:
        if refused := ladder.missing(light):
            print(f"{light}: skipped: {refused}", file=sys.stderr)
            continue
        changes = ladder.settings_of(light)
        variants = [Variant.parse(text) for text in ladder.variants(light)]
        for name in options.scenes.split(","):
            scene = with_overrides(load_scene(name, size=options.size), changes)
            for result in compare(
                scene, light, variants, reference_of(light), device, runs=options.runs,
                spp=options.spp, reference_spp=options.reference_spp, scale=options.scaled,
            ):  # fmt: skip
                results.append(result)
                print(
                    f"{light:8} {name:11} {result.variant:28} blocks |z| <= {result.blocks:5.2f}   "
                    f"whole z = {result.whole:6.2f}, {100 * result.relative:+.3f} % +- "
                    f"{100 * result.error:.3f} %",
                    flush=True,
                )
    limit, failed = verdict(results)
    print(f"{len(results)} comparisons, bound {limit:.2f}: {len(failed)} exceed it")
    for result in failed:
        print(f"FAILED {result.light} {result.scene} {result.variant}: {result.largest:.2f}")
    if options.output:
        write_json(_record(options, device, results, limit), options.output)
    return int(bool(failed))


def _record(
    options: argparse.Namespace, device: Device, results: list[Result], limit: float
) -> dict[str, Any]:
    rows: list[Mapping[str, Any]] = [vars(result) for result in results]
    return {
        "schema": "furcl-unbiased-1",
        **circumstances(device),
        "runs": options.runs,
        "spp": options.spp,
        "reference_spp": options.reference_spp,
        "alpha": ALPHA,
        "bound": limit,
        "results": rows,
    }


def parser() -> argparse.ArgumentParser:
    """The options, which the module's text explains."""
    found = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    found.add_argument("lights", nargs="*", choices=[[], *ladder.LIGHTS])
    found.add_argument("--scenes", default=",".join(ladder.SCENES))
    found.add_argument("--size", default="48x48")
    found.add_argument("--runs", type=int, default=16)
    found.add_argument("--spp", type=int, default=16)
    found.add_argument("--reference-spp", type=int, default=64)
    found.add_argument("--device")
    found.add_argument("--scaled", type=float, default=1.0)
    found.add_argument("-o", "--output", type=Path)
    return found


if __name__ == "__main__":
    sys.exit(run(parser().parse_args()))
