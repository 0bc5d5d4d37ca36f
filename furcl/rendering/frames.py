"""The pictures of an animation: what stays the same from one to the next is made once."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from furcl.device.choice import Device
from furcl.errors import SceneError
from furcl.groom.curves import Curves
from furcl.groom.joined import Grooms
from furcl.image.image import Image
from furcl.rendering.arguments import check_curves, check_stops, grooms_of
from furcl.rendering.renderer import Progress, Renderer, finished
from furcl.rendering.target import Target
from furcl.scene.orbit import orbit
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import MOST_SPP, Scene

MOST_FRAMES = 1 << 20


def frame_numbers(text: str) -> range:
    """The frames of "FIRST:END" or "FIRST:END:STEP"; END is the first that is not rendered.

    Raises
    ------
    SceneError      another text, no frames or more than MOST_FRAMES
    """
    numbers = re.fullmatch(r"(\d{1,9}):(\d{1,9})(?::(\d{1,9}))?", text.strip())
    frames = range(*(int(n) for n in numbers.groups("1"))) if numbers and numbers[3] != "0" else ()
    if not isinstance(frames, range) or not 0 < len(frames) <= MOST_FRAMES:
        raise SceneError(
            f"--frames {text}: expected FIRST:END or FIRST:END:STEP with FIRST < END; END is the "
            f"first frame that is not rendered, as in 0:24"
        )
    return frames


def frame_path(pattern: Path, frame: int) -> Path:
    """The file of a frame: its number in the place of the #s, with as many digits at least."""
    return pattern.with_name(
        re.sub(r"#+", lambda digits: f"{frame:0{len(digits[0])}}", pattern.name)
    )


def render_frames(
    scene: Scene | str | os.PathLike,
    frames: range,
    *,
    orbit_deg: float,
    device: str | Device | None = None,
    progress: Callable[[int], Progress] | None = None,
    time_limit: float | None = None,
    target_rmse: float | None = None,
    target_relmse: float | None = None,
    wave_size: int | None = None,
    curves: Curves | Grooms | Future[Curves] | Future[Grooms] | None = None,
    **changes: Any,
) -> Iterator[tuple[int, Image]]:
    """Render a turntable.

    From one frame to the next groom, tree, tables and kernels stay. Each picture is, to the bit,
    that which a render of its own gives with the frame's camera.

    Parameters
    ----------
    frames : range          their numbers
    orbit_deg : float       by how much the camera turns around the groom in all of them
                            (`furcl.scene.orbit`): frame i of n by i / n of it, so that 360 comes
                            round without a frame twice
    progress : callable     given a frame's number, returns what `furcl.render` takes as progress,
                            which stops that frame alone
    time_limit, target_rmse, target_relmse : float or None      of each frame
    changes                 spp, seed, sampling, max_depth; the others are those of `furcl.render`

    Yields
    ------
    int, Image      frame and picture

    Raises
    ------
    SceneError, GroomError, FibreError, DeviceError, ResourceError, KernelBuildError
    """
    check_stops(None, time_limit)
    check_curves(curves)
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    target = Target.of(target_rmse, target_relmse)
    if target and changes.get("spp") is None:
        changes["spp"] = MOST_SPP
    scene = with_overrides(scene, **changes)
    grooms = grooms_of(scene, curves)
    angles = [orbit_deg * i / len(frames) for i in range(len(frames))]
    cameras = orbit(scene, grooms.curves, angles, scene.build_meshes())
    renderer = None
    for frame, camera in zip(frames, cameras, strict=True):
        if renderer is None:
            renderer = Renderer(
                scene.seen_by(camera), device, wave_size, curves=grooms, target=target
            )
        else:
            renderer.look(camera)
        image = finished(renderer, progress(frame) if progress else None, time_limit)
        image.stats["frame"] = frame
        yield frame, image
