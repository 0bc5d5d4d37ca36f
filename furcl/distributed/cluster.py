"""Many machines that share a render: parts of the samples as tasks of dask.distributed."""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from furcl.distributed.parts import Merging, Part, parts_of, render_part
from furcl.errors import DeviceError
from furcl.groom.joined import Grooms
from furcl.image.image import Image
from furcl.rendering.arguments import Given, check_curves, check_stops, grooms_of
from furcl.rendering.renderer import Progress, Renderer
from furcl.scene.read import decode_scene, load_scene, with_overrides
from furcl.scene.schema import files_in
from furcl.scene.tables import Scene

if TYPE_CHECKING:
    from distributed import Client


#: How often a scene may be lost with all workers that had it while no part comes back.
LOSSES = 5


@dataclass(frozen=True, eq=False)
class Job:
    """All that a worker needs of a scene, which is sent to each once.

    Attributes
    ----------
    key : str           tells scenes apart
    document : dict     the scene with spp of a part; files by their digests
    files : dict        digest -> (suffix, bytes)
    grooms : Grooms
    wave_size : int or None
    device : str or None
    """

    key: str
    document: dict[str, Any]
    files: Mapping[str, tuple[str, bytes]]
    grooms: Grooms
    wave_size: int | None
    device: str | None

    @staticmethod
    def of(scene: Scene, grooms: Grooms, wave_size: int | None, device: str | None) -> Job:
        """The job of a scene."""
        document = msgspec.to_builtins(scene)
        files = {}
        for keys, table in files_in(document):
            path = Path(table[keys[-1]])
            if keys[0] == "curves" or "curves" in keys[2:]:
                continue  # grooms are sent as they are met by rays
            raw = path.read_bytes()
            table[keys[-1]] = hashlib.sha256(raw).hexdigest()
            files[table[keys[-1]]] = (path.suffix, raw)
        return Job(os.urandom(16).hex(), document, files, grooms, wave_size, device)

    def scene(self, folder: Path) -> Scene:
        """The scene, its files written to a folder."""
        document = self.document
        for digest, (suffix, raw) in self.files.items():
            (folder / f"{digest}{suffix}").write_bytes(raw)
        for keys, table in files_in(document):
            if table[keys[-1]] in self.files:
                suffix = self.files[table[keys[-1]]][0]
                table[keys[-1]] = str(folder / f"{table[keys[-1]]}{suffix}")
        return decode_scene(document)


class _Worker:
    """What a worker's process keeps between tasks: the renderer of one job, and its files."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._key = ""
        self._renderer: Renderer | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def renderer_of(self, job: Job) -> Renderer:
        """The renderer of a job, made for its first task here."""
        if self._renderer is None or self._key != job.key:
            self._renderer = None  # its memory is needed
            self._folder = tempfile.TemporaryDirectory()
            scene = job.scene(Path(self._folder.name))
            self._renderer = Renderer(scene, job.device, job.wave_size, curves=job.grooms)
            self._key = job.key
        return self._renderer


_worker = _Worker()


def _task(job: Job, part: Part) -> Image:
    """A part, on a worker: one at a time, each uses all of the device."""
    with _worker.lock:
        return render_part(_worker.renderer_of(job), part)


def _send(client: Client, job: Job) -> Any:
    """A future of the job, on the workers that are there."""
    try:
        return client.scatter(job, broadcast=True, hash=False)
    except TimeoutError:
        raise DeviceError(
            "the cluster has no worker: start some by dask worker ADDRESS, with furcl installed"
        ) from None


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
                    had it, LOSSES times without a part between
    FurclError      as `furcl.render`, of the first part that fails
    """
    check_stops(progress, time_limit)
    check_curves(curves)
    try:
        from distributed import CancelledError, Client, KilledWorker, as_completed
    except ImportError:
        raise DeviceError(
            "rendering on a cluster needs the package distributed; install it with "
            "pip install 'furcl[cluster]'"
        ) from None
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    scene = with_overrides(scene, spp=spp, seed=seed)
    parts = parts_of(scene, part_spp)
    if isinstance(client, str):
        try:
            with Client(client) as own:
                return render(
                    scene, own, part_spp=part_spp, device=device, progress=progress,
                    time_limit=time_limit, wave_size=wave_size, curves=curves,
                )  # fmt: skip
        except (OSError, ValueError) as error:
            raise DeviceError(f"--dask {client}: no scheduler answers there: {error}") from None
    grooms = grooms_of(scene, curves)
    job = Job.of(with_overrides(scene, spp=parts[0].spp), grooms, wave_size, device)
    start = time.perf_counter()
    sent, sending = _send(client, job), 0
    n_pixels = scene.film.width * scene.film.height
    merging, left, done, stopped = Merging(), {part.number for part in parts}, 0, False
    coming, tasks, losses = as_completed(), {}, 0

    def begin(part: Part, again: bool = False) -> None:
        priority = -part.number - (len(parts) if again else 0)
        task = client.submit(_task, sent, part, pure=False, priority=priority)
        tasks[task] = part, sending
        coming.add(task)

    try:
        for part in parts:
            begin(part)
        for task in coming:
            part, with_sending = tasks.pop(task)
            if part.number not in left:
                continue
            try:
                merging.add(part, task.result())
            except KilledWorker as error:
                raise DeviceError(f"part {part.number} of {len(parts)}: {error}") from None
            except CancelledError as error:
                # Tasks go with the scene that they were given.
                if with_sending == sending:
                    losses += 1
                    if losses > LOSSES:
                        raise DeviceError(
                            f"the scene was lost {losses} times with the workers: {error}"
                        ) from None
                    sent, sending = _send(client, job), sending + 1
                begin(part)
                continue
            left.remove(part.number)
            losses = 0
            done += part.spp * n_pixels
            over = time_limit is not None and time.perf_counter() - start >= time_limit
            if over or (progress and progress(done, scene.render.spp * n_pixels)):
                stopped = bool(left)
                break
            if not left:
                break
            # Workers that have nothing to do take what others are not ready with.
            if len(tasks) == len(left) <= len(client.scheduler_info()["workers"]) // 2:
                for number in sorted(left):
                    begin(parts[number], again=True)
    finally:
        client.cancel(list(tasks))
    image = merging.image()
    assert image is not None
    image.stats["seconds"]["wall"] = time.perf_counter() - start
    image.stats["complete"] = not stopped
    return image
