"""`furcl render --frames`: the pictures of a turntable."""

from __future__ import annotations

import logging
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from furcl.cli.interrupt import interruptible
from furcl.progress import progress_report

if TYPE_CHECKING:
    from furcl.scene.tables import Scene

log = logging.getLogger(__name__)


def check_frames(
    frames: str | None, orbit: float | None, output: Path, stats: Path | None, kept: bool
) -> None:
    """Refuse options that do not go together; `kept` is whether there is a checkpoint.

    Raises
    ------
    BadParameter    --frames without --orbit, or the other way round; files that all frames share;
                    --frames with a checkpoint
    """
    if frames is not None and kept:
        raise typer.BadParameter(
            "--frames goes without --checkpoint and --resume, which are for one picture; render "
            "the frames that are missing, as in --frames 7:8"
        )
    if (frames is None) != (orbit is None):
        raise typer.BadParameter(
            "--frames says which pictures, --orbit by how many degrees the camera turns in them; "
            "give both, for example --frames 0:24 --orbit 360"
        )
    for path in (output, stats):
        if path and (frames is None) == ("#" in path.name):
            raise typer.BadParameter(
                f"{path}: {'without' if frames is None else 'with'} --frames the name "
                f"{'must not hold' if frames is None else 'must hold'} #, which stands for a "
                f"digit of the frame's number, as in turn.####.exr"
            )


def render_all(
    scene: Scene,
    frames: str,
    orbit: float,
    *,
    output: Path,
    stats: Path | None,
    denoise: bool = False,
    **options: Any,
) -> None:
    """Render the frames, write each as soon as it is there, denoised as well if asked for; options
    are those of render_frames."""
    from furcl.cli.outputs import Outputs
    from furcl.cli.render import tell_what_was_reached

    with interruptible() as interrupt:
        with ThreadPoolExecutor(1) as beside:
            curves = beside.submit(scene.build_grooms)
            from furcl.rendering.frames import frame_numbers, frame_path, render_frames

            numbers = frame_numbers(frames)
            with progress_report() as report:

                def progress_of(frame: int) -> Any:
                    at = numbers.index(frame)

                    def progress(done: int, total: int) -> bool:
                        report(at * total + done, len(numbers) * total)
                        return interrupt.requested

                    return progress

                pictures = render_frames(
                    scene,
                    numbers,
                    orbit_deg=orbit,
                    curves=curves,
                    progress=progress_of,
                    **options,
                )
                for frame, image in pictures:
                    of_frame = stats and frame_path(stats, frame)
                    named = frame_path(output, frame)
                    Outputs.of(named, of_frame, denoise=denoise).write(image)
                    tell_what_was_reached(image.stats, scene.render.spp)
                    if interrupt.requested:
                        break
        if interrupt.requested:
            raise interrupt.exit()
