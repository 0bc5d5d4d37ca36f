"""`furcl render`."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from furcl.cli.frames import check_frames, render_all
from furcl.cli.interrupt import interruptible
from furcl.cli.options import (
    SAMPLER_FILE,
    SEED,
    SIZE,
    SPP,
    Dask,
    Material,
    Overrides,
    SceneName,
    UpAxis,
    WaveSize,
)

if TYPE_CHECKING:
    from furcl.groom.joined import Grooms
    from furcl.scene.tables import Scene
from furcl.cli.shared import Shared, sample_range
from furcl.progress import progress_report

log = logging.getLogger(__name__)


def render(
    scene: SceneName,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="OUT.exr; a PNG preview is written beside it."),
    ],
    spp: Annotated[int | None, SPP] = None,
    seed: Annotated[int | None, SEED] = None,
    size: Annotated[str | None, SIZE] = None,
    sampling: Annotated[
        str | None, typer.Option(help="uniform-h, attenuation-cdf, full-cdf or all-lobes.")
    ] = None,
    sampler: Annotated[Path | None, SAMPLER_FILE] = None,
    max_depth: Annotated[int | None, typer.Option(help="Longest path, in bounces.")] = None,
    camera: Annotated[
        str | None, typer.Option(help="Name of a camera, of a scene with several.")
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            help="Number in `furcl devices`, P:D, or part of a name; several with commas between, "
            "or all, share the render."
        ),
    ] = None,
    samples: Annotated[
        str | None,
        typer.Option(
            help="FIRST:END, only these samples of each pixel, in place of --spp; see furcl merge."
        ),
    ] = None,
    dask: Dask = None,
    part_spp: Annotated[
        int | None, typer.Option(help="Samples per pixel in each part of a shared render.")
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option(help="Stop after so many seconds and write what is there.")
    ] = None,
    target_rmse: Annotated[
        float | None,
        typer.Option(help="Stop at this RMSE of linear radiance, as estimated; --spp limits it."),
    ] = None,
    target_relmse: Annotated[
        float | None, typer.Option(help="Stop at this relMSE, as estimated; --spp limits it.")
    ] = None,
    stats: Annotated[Path | None, typer.Option(help="Write statistics to this JSON file.")] = None,
    checkpoint: Annotated[
        float | None,
        typer.Option(help="Keep the render in OUT.checkpoint every so many minutes, and its end."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(help="Go on from a checkpoint, to the bits of a render that never stopped."),
    ] = None,
    display: Annotated[
        str | None,
        typer.Option(help="HOST:PORT of a tev, an image viewer, that shows the picture so far."),
    ] = None,
    wave_size: WaveSize = None,
    frames: Annotated[
        str | None,
        typer.Option(help="FIRST:END, a turntable's frames; -o then names files as turn.####.exr."),
    ] = None,
    orbit: Annotated[
        float | None,
        typer.Option(help="Degrees by which the camera goes around the groom in all frames."),
    ] = None,
    denoise: Annotated[
        bool,
        typer.Option("--denoise", help="Write OUT.denoised.exr as well: biased, for previews."),
    ] = False,
    material: Material = None,
    up: UpAxis = None,
    overrides: Overrides = None,
) -> None:
    """Render a scene, or a groom framed under a sky, to OpenEXR and PNG."""
    from furcl.cli.outputs import Outputs
    from furcl.fibre import samplers
    from furcl.scene.from_groom import is_groom
    from furcl.scene.read import find_scene, load_scene
    from furcl.scene.schema import files_of

    keeps = checkpoint is not None or resume is not None
    check_frames(frames, orbit, output, stats, keeps)
    if frames is not None and samples is not None:
        raise typer.BadParameter("--frames and --samples: an animation is rendered as it is")
    if frames is not None and display is not None:
        raise typer.BadParameter("--frames and --display: an animation is shown by its files")
    wanted = sample_range(samples)
    shared = Shared.of(device, dask, part_spp)
    if shared:
        shared.check(
            {
                "--frames": frames, "--samples": samples, "--checkpoint": checkpoint,
                "--resume": resume, "--display": display,
                "--target-rmse": target_rmse, "--target-relmse": target_relmse,
            }
        )  # fmt: skip
    outputs = Outputs.of(output, stats, denoise=denoise)
    if denoise:
        check_denoise()
    outputs.check([find_scene(scene), *([sampler] if sampler else [])])
    if sampler:
        if sampling:
            raise typer.BadParameter("--sampler and --sampling name two samplers; keep one")
        sampling = samplers.register(sampler.stem, sampler).name
    bare = is_groom(find_scene(scene))
    loaded = load_scene(
        scene,
        overrides=[*of_groom(bare, material, up), *(overrides or ())],
        spp=spp,
        seed=seed,
        size=size,
        sampling=sampling,
        max_depth=max_depth,
        camera=camera,
    )
    if denoise:
        loaded = with_guides(loaded)
    outputs.check_apart(files_of(loaded))
    if frames is not None:
        limits = {"target_rmse": target_rmse, "target_relmse": target_relmse}
        options = {"spp": spp, "device": device, "wave_size": wave_size, "time_limit": time_limit}
        render_all(
            loaded, frames, orbit or 0.0, output=output, stats=stats, denoise=denoise,
            **options, **limits,
        )  # fmt: skip
        return
    with interruptible() as interrupt:
        with progress_report() as report:

            def progress(done: int, total: int) -> bool:
                report(done, total)
                return interrupt.requested

            # The groom is made while OpenCL and what works with it is loaded.
            with ThreadPoolExecutor(1) as beside:
                curves = beside.submit(_built, loaded, bare)
                from furcl.rendering.renderer import render as render_scene

                common: dict[str, Any] = {
                    "curves": curves,
                    "progress": progress,
                    "time_limit": time_limit,
                    "wave_size": wave_size,
                }
                if shared:
                    image = shared.render(loaded, **common)
                else:
                    image = render_scene(
                        loaded,
                        spp=spp,
                        device=device,
                        samples=wanted,
                        target_rmse=target_rmse,
                        target_relmse=target_relmse,
                        checkpoint=outputs.checkpoint,
                        checkpoint_minutes=checkpoint,
                        resume=resume,
                        display=display,
                        **common,
                    )
        outputs.write(image)
    first, end = wanted or (0, loaded.render.spp)
    tell_what_was_reached(image.stats, end - first)
    if interrupt.requested:
        raise interrupt.exit()


def check_denoise() -> None:
    """Refuse, before a render, a preview that could not be made after it."""
    from importlib.util import find_spec

    from furcl.errors import ImageError
    from furcl.image.denoise import NEEDED

    if find_spec("pyoidn") is None:
        raise ImageError(NEEDED)


def with_guides(scene: Scene) -> Scene:
    """A scene whose picture has the layers that guide the denoiser."""
    from msgspec.structs import replace

    from furcl.image.denoise import LAYERS

    wanted = tuple(dict.fromkeys((*scene.film.layers, *LAYERS)))
    return replace(scene, film=replace(scene.film, layers=wanted))


def of_groom(bare: bool, material: str | None, up: str | None) -> list[str]:
    """The changes that options make of a scene which is a groom alone."""
    from furcl.scene.from_groom import material_override

    if not bare and (material or up):
        raise typer.BadParameter(
            "--material and --up are of a groom without a scene; of a scene give --set "
            "fibre.preset=NAME and --set curves.up_axis=AXIS"
        )
    changes = [material_override(material)] if material else []
    return [*changes, *([f"curves.up_axis={up}"] if up else [])]


def _built(loaded: Scene, bare: bool) -> Grooms:
    """The grooms; widths of a groom without a scene are questioned."""
    from furcl.groom.widths import question

    grooms = loaded.build_grooms()
    asked = question(grooms.curves) if bare else ""
    if asked:
        log.warning("%s", asked)
    return grooms


def tell_what_was_reached(stats: dict[str, Any], spp: int) -> None:
    """Warn of a render that was stopped; log the error that it reached."""
    done = stats.get("spp", spp)
    [(name, target)] = (stats.get("target") or {"rmse": None}).items()
    stopped = target is not None and not stats["complete"]
    if target is None and done < spp:
        log.warning("stopped early: %s of %s samples a pixel", done, spp)
    error, found = (stats.get("error") or {}).get(name), "unknown"
    if error:
        # The variance of samples that depend on each other says more than the error.
        bound = "; an upper bound" if stats.get("sequence") == "sobol" else ""
        found = f"{error['estimate']:.3g} ({error['low']:.3g} to {error['high']:.3g}{bound})"
    if error or target is not None:
        log.log(
            logging.WARNING if stopped else logging.INFO,
            f"{'stopped early at' if stopped else 'reached'} {name} {found}"
            f"{'' if target is None else f' of {target:.3g}'} with {done} samples a pixel",
        )


def register(app: typer.Typer) -> None:
    """Add the command to the app."""
    app.command()(render)
