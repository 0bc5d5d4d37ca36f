"""`furcl bench variance`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated, Any

import typer

from furcl.cli.console import print_table
from furcl.cli.options import (
    SAMPLER_FILE,
    SAMPLING,
    SEED,
    SIZE,
    VARIANT,
    DeviceName,
    Folder,
    Overrides,
    SceneNames,
)

log = logging.getLogger(__name__)


def variance(
    scenes: SceneNames,
    out: Folder,
    variant: Annotated[list[str] | None, VARIANT] = None,
    sampling: Annotated[str | None, SAMPLING] = None,
    sampler: Annotated[list[Path] | None, SAMPLER_FILE] = None,
    size: Annotated[str | None, SIZE] = None,
    bounces: Annotated[int, typer.Option(help="Bounces that are told apart.")] = 2,
    groups: Annotated[int, typer.Option(help="Repetitions, which intervals are over.")] = 16,
    group_size: Annotated[int, typer.Option(help="Samples a pixel in each, sharing numbers.")] = 8,
    seed: Annotated[int, SEED] = 1,
    device: DeviceName = None,
    overrides: Overrides = None,
) -> None:
    """Take the variance of pictures apart: camera, offset h, lobe, direction, light, roulette.

    Of independent samples, the same number for every pixel, whatever the scene says. Each part is
    what is gained by fixing its numbers after those before it: all parts together are the variance.
    """
    from furcl.bench import variance as bench
    from furcl.bench.convergence_variants import Variant
    from furcl.fibre import samplers
    from furcl.report.variance import write_figures

    own = [samplers.register(path.stem, path).name for path in sampler or ()]
    named = [*(sampling.split(",") if sampling else ()), *own]
    variants = [Variant.parse(text) for text in variant or ()]
    variants += [Variant.of_sampler(name) for name in named]
    results = bench.run(
        scenes,
        out,
        variants=variants,
        device=device,
        size=size,
        bounces=bounces,
        groups=groups,
        samples=group_size,
        seed=seed,
        overrides=overrides or (),
    )
    columns = ["numbers", "bounce", "variance", "share", "alone"]
    for scene in results["scenes"]:
        for found in scene["variants"]:
            typer.echo(
                f"{scene['name']}, {found['name']}: variance of a sample "
                f"{_interval(found['variance'])}; RMSE over that of "
                f"{scene['variants'][0]['name']} {_interval(found['rmse'])}, without the camera's "
                f"part {_interval(found['path_rmse'])}"
            )
            alone = {part["kind"]: part["variance"]["mean"] for part in found["alone"]}
            print_table(columns, [_row(part, alone) for part in found["parts"]])
    for path in write_figures(results, out):
        log.info("wrote %s", path)


def _row(part: dict[str, Any], alone: dict[str, float]) -> list[Any]:
    """A part; beside those of camera and first bounce what their kind leaves alone."""
    first = part["bounce"] in (None, 0) and part["kind"] in alone
    return [
        part["kind"],
        "" if part["bounce"] is None else part["bounce"] + 1,
        _interval(part["variance"]),
        f"{100.0 * part['share']:.1f} %",
        f"{alone[part['kind']]:.3g}" if first else "",
    ]


def _interval(found: dict[str, Any]) -> str:
    if found["mean"] is None:
        return "-"
    return f"{found['mean']:.3g} [{found['low']:.3g}, {found['high']:.3g}]"
