"""`furcl bench convergence`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from furcl.cli.interrupt import interruptible
from furcl.cli.options import (
    METRIC,
    QUICK,
    SAMPLER_FILE,
    SAMPLING,
    SEED,
    SIZE,
    VARIANT,
    Dask,
    DeviceName,
    Overrides,
    SceneNames,
    results_folder,
)
from furcl.progress import progress_report

log = logging.getLogger(__name__)


def convergence(
    scenes: SceneNames,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Folder; one that holds a stopped run continues it.",
            callback=results_folder,
        ),
    ],
    variant: Annotated[list[str] | None, VARIANT] = None,
    sampling: Annotated[str | None, SAMPLING] = None,
    baseline: Annotated[
        str, typer.Option(help="Variant that the others are compared with; the first, if left out.")
    ] = "",
    sampler: Annotated[list[Path] | None, SAMPLER_FILE] = None,
    spp: Annotated[
        str | None, typer.Option(help="Samples per pixel, ascending: 64,128,256.")
    ] = None,
    runs: Annotated[int, typer.Option(help="Independent renders of each.")] = 5,
    size: Annotated[str | None, SIZE] = None,
    seed: Annotated[int, SEED] = 1,
    reference_spp: Annotated[
        int, typer.Option(help="Of the reference; 0: 16 times the largest --spp.")
    ] = 0,
    metric: Annotated[str, METRIC] = "rmse",
    device: DeviceName = None,
    dask: Dask = None,
    quick: Annotated[bool, QUICK] = False,
    overrides: Overrides = None,
) -> None:
    """Compare the error of variants of a scene over run time, against a reference."""
    from furcl.bench import convergence as bench
    from furcl.bench.convergence_plan import QUICK_SPP, SAMPLING, SPP, Plan, quick_scene
    from furcl.bench.convergence_variants import Variant
    from furcl.fibre import samplers
    from furcl.report.convergence import interval, median, write_report
    from furcl.report.convergence_checks import departures
    from furcl.scene.read import load_scene

    loaded = [load_scene(scene, overrides=overrides or (), size=size) for scene in scenes]
    if quick:
        loaded = [quick_scene(scene, keep_size=size is not None) for scene in loaded]
    own = [samplers.register(path.stem, path).name for path in sampler or ()]
    variants = tuple(Variant.parse(text) for text in variant or ())
    named = sampling.split(",") if sampling else () if variants else SAMPLING
    used = {setting for one in variants for setting in one.settings}
    own = [name for name in own if f"render.sampling={name}" not in used]
    plan = Plan(
        tuple(loaded),
        variants,
        sampling=(*named, *own),
        baseline=baseline,
        spp=_numbers(spp) if spp else QUICK_SPP if quick else SPP,
        runs=runs,
        seed=seed,
        reference_spp=reference_spp,
    )
    with interruptible() as interrupt:
        with progress_report() as report:

            def progress(done: int, total: int) -> bool:
                report(done, total)
                return interrupt.requested

            results = bench.run(plan, output, device=device, progress=progress, client=dask)
        page = write_report(output, metrics=metric.split(","))
    marked = departures(results)
    for scene in results["scenes"]:
        for found in scene["comparisons"]:
            ratio = found["equal_time"][-1]["rmse_ratio"]
            typer.secho(
                f"{scene['name']}: RMSE of {found['variant']} at equal time over that of "
                f"{found['baseline']}: {interval(ratio)}, median {median(ratio)}; efficiency "
                f"{interval(found['efficiency'])}",
                fg=typer.colors.RED if (scene["name"], found["variant"]) in marked else None,
            )
        if scene["unresolved"]:
            log.warning(
                "%s: an error of %s is below that of the reference; give a larger --reference-spp",
                scene["name"],
                ", ".join(scene["unresolved"]),
            )
    for (name, rendered), said in marked.items():
        text = f"{name}: {rendered} makes another picture: {'; '.join(said)}"
        typer.secho(text, fg=typer.colors.RED, err=True)
    log.info("wrote %s, results.json and results.csv", page)
    if not results["complete"]:
        log.warning("stopped early; the same command continues")
        raise interrupt.exit()


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"--spp {text}: expected whole numbers, for example 64,128"
        ) from None
