"""`furcl bench variance`: which numbers of a path the variance of a picture comes from.

Two samples of a pixel that share some numbers X and are independent in all others differ by what
the others decide: the mean of their variance is E[Var(f | X)]. Numbers are fixed one kind after the
other, the camera's first, then those of the first bounce in the order of
`furcl.rendering.held.KINDS`, then those of the second; the variance that each takes away is its
part, and all parts together are the variance (Sobol 1993). A part holds what its numbers decide
together with those before them. Beside that stands what a kind leaves alone, all other numbers of
all bounces fixed: these hold what the numbers decide together with any others, so they need not add
up.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from furcl.bench.convergence_statistics import Estimate, mean_interval
from furcl.bench.convergence_variants import Variant
from furcl.bench.record import circumstances, write_json
from furcl.device.choice import Device, open_device
from furcl.errors import BenchError
from furcl.files import atomic_path, file_name
from furcl.rendering.held import KINDS, Held, Kind, all_but
from furcl.rendering.renderer import Renderer
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene

log = logging.getLogger(__name__)

Array = NDArray[np.float64]

# Variance is that of one independent sample, however samples are spread in the scene's own renders.
OF_A_SAMPLE = ("render.sequence=independent", "render.allocation=even", "render.variance=true")
# Seeds of groups follow each other; those of variants and of positions are the same.
CAMERA, LATER, ALL = "camera", "later", "all"


@dataclass(frozen=True, eq=False)
class Left:
    """Variance that is left where some numbers are held.

    Attributes
    ----------
    groups : (n,) float64               of a sample, mean over pixels and channels: of each group of
                                        samples that share the held numbers
    pixels : (height, width) float64    mean over groups and channels
    """

    groups: Array
    pixels: Array


def prepared(scene: Scene, settings: Iterable[str] = ()) -> Scene:
    """The scene with settings, and as its variance is measured (OF_A_SAMPLE)."""
    return with_overrides(scene, [*settings, *OF_A_SAMPLE])


def learned(renderer: Renderer) -> Renderer:
    """The renderer after the samples that it learns from, if it learns."""
    if renderer.setup.learning:
        recorded = renderer.setup.learning.recorded
        renderer.advance(-(-recorded // renderer.n_pixels))
    return renderer


def left(renderer: Renderer, held: Held, groups: int, samples: int, seed: int = 1) -> Left:
    """The variance that is left with numbers held: the mean of `groups` unbiased estimates, each of
    `samples` samples a pixel that share these numbers. The renderer was made with `held`."""
    renderer.held = held
    means, pixels = np.zeros(groups), np.zeros((renderer.film.height, renderer.film.width))
    for group in range(groups):
        renderer.empty_film(seed + group)
        renderer.advance(samples)
        _, variance, _ = renderer.film.read(renderer.memory)
        of_a_sample = variance.mean(axis=2, dtype=np.float64) * samples
        means[group] = of_a_sample.mean()
        pixels += of_a_sample / groups
    return Left(means, pixels)


def played(renderer: Renderer, bounce: int) -> list[Kind]:
    """The kinds of numbers that a bounce of the scene's paths uses, in order."""
    features, render = renderer.features, renderer.scene.render
    roulette = features.shadow_roulette or (
        features.roulette and bounce >= renderer.scene.render.first_roulette
    )
    unused: set[str] = set()
    if bounce >= render.max_depth:
        return []
    if not features.light_sampling:
        unused.add("light")
    if not roulette:
        unused.add("roulette")
    return [kind for kind in KINDS if kind not in unused]


def positions(renderer: Renderer, bounces: int) -> Iterator[tuple[str, int | None, Held]]:
    """Kind, bounce and all that is held from it on: the camera first."""
    yield CAMERA, None, Held(camera=True)
    for bounce in range(bounces):
        for kind in played(renderer, bounce):
            upto = KINDS[: KINDS.index(kind) + 1]
            yield kind, bounce, Held(camera=True, bounce=bounce, before=KINDS, at=upto)


def measure(
    scene: Scene,
    device: Device,
    *,
    bounces: int = 3,
    groups: int = 16,
    samples: int = 8,
    seed: int = 1,
) -> tuple[dict[str, Any], dict[str, Array], dict[str, Array]]:
    """Take the variance of a scene's samples apart.

    Parameters
    ----------
    scene : Scene       what `prepared` returns
    bounces : int       whose kinds of numbers are told apart; 0: the camera alone
    groups : int        independent repetitions, which intervals are over; at least two
    samples : int       of a pixel in each, at least two

    Returns
    -------
    found : dict        `variance` of a sample, mean over pixels and channels [radiance^2]; `parts`:
                        `kind`, `bounce`, `variance` and `share` each, which add up; `alone`: the
                        same of each kind with all others held; estimates are dicts
    maps : dict         "kind" or "kind bounce" -> (height, width), the parts pixel by pixel
    groups : dict       the variance left, (groups,): "all" with nothing, "camera" with the camera
                        held

    Raises
    ------
    what a render raises
    """
    renderer = learned(Renderer(scene, device, held=Held()))

    def found_left(held: Held) -> Left:
        return left(renderer, held, groups, samples, seed)

    whole = found_left(Held())
    total = float(whole.groups.mean())
    parts, maps, before, camera = [], {}, whole, whole
    for kind, bounce, held in positions(renderer, bounces):
        after = found_left(held)
        parts.append(_part(kind, bounce, before.groups - after.groups, total))
        maps[kind if bounce is None else f"{kind} {bounce}"] = before.pixels - after.pixels
        camera = after if bounce is None else camera
        before = after
    parts.append(_part(LATER, None, before.groups, total))
    maps[LATER] = before.pixels
    of_bounces = (played(renderer, bounce) for bounce in range(scene.render.max_depth))
    kinds: list[Kind | None] = [None, *dict.fromkeys(kind for own in of_bounces for kind in own)]
    alone = [_part(kind or CAMERA, None, found_left(all_but(kind)).groups, total) for kind in kinds]
    found = {
        "variance": mean_interval(whole.groups).as_dict(),
        "parts": parts,
        "alone": alone,
        "paths": renderer.paths_done,
        "rays_per_path": renderer.rays / renderer.paths_done,
    }
    return found, maps, {ALL: whole.groups, CAMERA: camera.groups}


def _part(kind: str, bounce: int | None, groups: Array, total: float) -> dict[str, Any]:
    estimate = mean_interval(groups)
    return {
        "kind": kind,
        "bounce": bounce,
        "variance": estimate.as_dict(),
        "share": estimate.mean / total if total else 0.0,
    }


def rmse_ratio(of: Array, over: Array) -> Estimate:
    """The root of a ratio of means of groups that share their seeds, with a 95 % interval.

    Of the logarithm, by the jackknife over groups and Student's t (Quenouille 1956, "Notes on bias
    in estimation"). NaN where a mean is not positive.
    """
    n = len(of)
    if of.sum() <= 0.0 or over.sum() <= 0.0:
        return Estimate(np.nan, np.nan, np.nan, n)

    def log_ratio(a: Any, b: Any) -> Any:
        with np.errstate(divide="ignore", invalid="ignore"):
            return 0.5 * np.log(a / b)

    whole = log_ratio(of.sum(), over.sum())
    without = log_ratio(of.sum() - of, over.sum() - over)
    e = mean_interval(n * whole - (n - 1) * without)
    return Estimate(float(np.exp(e.mean)), float(np.exp(e.low)), float(np.exp(e.high)), n)


def run(
    scenes: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    variants: Sequence[Variant] = (),
    device: str | Device | None = None,
    size: str | None = None,
    bounces: int = 3,
    groups: int = 16,
    samples: int = 8,
    seed: int = 1,
    overrides: Iterable[str] = (),
) -> dict[str, Any]:
    """Take the variance of scenes apart, for each of several variants of them.

    Writes results.json, and the parts of every pixel (`maps_of`), to `out`.

    Returns
    -------
    dict    `scenes`: `name`, and of each of its `variants` what `measure` found, and over the first
            variant `rmse` and `path_rmse`: RMSE at equal samples, whole and of the paths alone,
            that is without the camera's part

    Raises
    ------
    BenchError      two variants of one name; numbers below the least
    SceneError and what else a render raises
    """
    for name, number, least in (
        ("groups", groups, 2),
        ("group-size", samples, 2),
        ("bounces", bounces, 0),
    ):
        if number < least:
            raise BenchError(f"--{name} {number}: give {least} or more")
    variants = variants or (Variant("scene"),)
    names = [variant.name for variant in variants]
    if len(set(names)) < len(names):
        raise BenchError(f"variants {', '.join(names)}: a name is there twice; give each its own")
    opened = device if isinstance(device, Device) else open_device(device)
    loaded = [load_scene(path, overrides=list(overrides), size=size) for path in scenes]
    rows = []
    for scene in loaded:
        found_of: list[dict[str, Any]] = []
        first: dict[str, Array] = {}
        for variant in variants:
            log.info("%s, %s", scene.name, variant.name)
            own = prepared(variant.scene(scene))
            found, maps, left_of = measure(
                own, opened, bounces=bounces, groups=groups, samples=samples, seed=seed
            )
            first = first or left_of
            ratios = {
                "rmse": rmse_ratio(left_of[ALL], first[ALL]).as_dict(),
                "path_rmse": rmse_ratio(left_of[CAMERA], first[CAMERA]).as_dict(),
            }
            found_of.append({**variant.as_dict(), **found, **ratios})
            write_maps(maps, Path(out) / maps_of(scene.name, variant.name))
        size_of = [scene.film.window.width, scene.film.window.height]
        rows.append({"name": scene.name, "size": size_of, "variants": found_of})
    numbers = {"bounces": bounces, "groups": groups, "samples": samples, "seed": seed}
    results = {**circumstances(opened), **numbers, "scenes": rows}
    write_json(results, Path(out) / "results.json")
    return results


def maps_of(scene: str, variant: str) -> Path:
    """The file of a variant's maps, in the folder of the results."""
    return Path("maps") / f"{file_name(f'{scene}-{variant}')}.npz"


def write_maps(maps: dict[str, Array], path: Path) -> None:
    """Write maps whole or not at all; missing folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **{k: v.astype(np.float32) for k, v in maps.items()})  # pyright: ignore[reportArgumentType]
