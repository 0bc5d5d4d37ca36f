"""Many machines that share a render: parts of the samples as tasks of dask.distributed."""

from __future__ import annotations

import os
import time
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

from furcl.device.choice import Device
from furcl.distributed.job import Job
from furcl.distributed.parts import Merging, Part, parts_of, render_part
from furcl.distributed.tasks import Shared, Workers, connected
from furcl.distributed.worker import made
from furcl.image.image import Image
from furcl.rendering.arguments import Given, check_curves, check_stops, grooms_of
from furcl.rendering.renderer import Progress, Renderer
from furcl.scene.read import load_scene, with_overrides
from furcl.scene.tables import Scene

if TYPE_CHECKING:
    from distributed import Client


@dataclass(frozen=True, eq=False)
class _Work:
    """A scene with spp of a part, and the size of waves."""

    job: Job
    wave_size: int | None


def _task(device: Device, work: _Work, part: Part) -> Image:
    """A part, on a worker."""

    def make(scene: Scene) -> Renderer:
        return Renderer(scene, device, work.wave_size, curves=work.job.grooms)

    return render_part(made(work.job, make), part)


def render(
    scene: Scene | str | os.PathLike,
    client: Client | str,
    *,
    spp: int | None = None,
    seed: int | None = None,
    part_spp: int | None = None,
    device: str | None = None,
    progress: Progress | None = None,
    time_limit: float | None = None,
    wave_size: int | None = None,
    curves: Given = None,
) -> Image:
    """Render a scene on the workers of a Dask cluster.

    The scene, its groom and the files it names are sent to each worker once; workers need furcl
    and an OpenCL device, no files. Each takes parts of the samples (`furcl.distributed.parts`),
    one at a time, and sends a picture back. A lost worker costs the parts that it had, which
    others take, as they take those of a slow one when they have nothing left. The scene is sent
    again where it went with the workers: Dask keeps as few copies of it as it can. The picture is
    that of `render_on` with the same parts, to the bit where devices are of one kind.

    Parameters
    ----------
    scene : Scene or path
    client : Client or text         of the cluster, or the address of its scheduler
    part_spp : int or None          samples a pixel in each part
    device : str or None            on each worker, as for `furcl.render`
    progress, time_limit            as for `furcl.render`, asked when a part is ready
    spp, seed, wave_size, curves    as for `furcl.render`

    Raises
    ------
    DeviceError     dask.distributed is not installed, no scheduler answers, no worker is there, a
                    part was lost with more workers than the scheduler allows
                    (distributed.scheduler.allowed-failures), or the scene with all workers that
                    had it, furcl.distributed.tasks.LOSSES times without a part between
    FurclError      as `furcl.render`, of the first part that fails
    """
    check_stops(progress, time_limit)
    check_curves(curves)
    with connected(client) as cluster:
        scene = scene if isinstance(scene, Scene) else load_scene(scene)
        scene = with_overrides(scene, spp=spp, seed=seed)
        parts = parts_of(scene, part_spp)
        job = Job.of(with_overrides(scene, spp=parts[0].spp), grooms_of(scene, curves))
        start = time.perf_counter()
        shared = Shared(Workers(cluster, device, one_kind=False), _Work(job, wave_size))
        n_pixels = scene.film.width * scene.film.height
        merging, done, n_merged = Merging(), 0, 0
        coming = shared.results(
            _task, parts, lambda part: f"part {part.number} of {len(parts)}", twice=True
        )
        with closing(coming):
            for part, image in coming:
                merging.add(part, image)
                n_merged += 1
                done += part.spp * n_pixels
                over = time_limit is not None and time.perf_counter() - start >= time_limit
                if over or (progress and progress(done, scene.render.spp * n_pixels)):
                    break
        image = merging.image()
        assert image is not None
        image.stats["seconds"]["wall"] = time.perf_counter() - start
        image.stats["complete"] = n_merged == len(parts)
        return image
