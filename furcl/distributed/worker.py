"""What happens in the process of a worker: one task at a time, each with all of the device."""

from __future__ import annotations

import socket
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from furcl.device.choice import Device, open_device
from furcl.distributed.job import Job
from furcl.errors import DeviceError
from furcl.scene.tables import Scene

T = TypeVar("T")


@dataclass(frozen=True)
class Place:
    """Where a task was done.

    Attributes
    ----------
    worker : str            address
    host : str              name of the machine
    name, platform, driver_version : str        of the device, as its runtime reports them
    is_cpu : bool           whether the device is the machine's processor
    """

    worker: str
    host: str
    name: str
    platform: str
    driver_version: str
    is_cpu: bool

    @property
    def description(self) -> str:
        """Worker and device."""
        return f"{self.worker}: {self.name} ({self.platform}, driver {self.driver_version})"

    def check(self, other: Place) -> None:
        """Refuse a worker whose device is of another kind.

        Raises
        ------
        DeviceError     names both
        """
        if (self.name, self.platform, self.driver_version) != (
            other.name, other.platform, other.driver_version,
        ):  # fmt: skip
            raise DeviceError(
                f"workers with different devices: {self.description}, and {other.description}; "
                f"times and pictures are compared between devices of one kind and driver alone: "
                f"end the others, or name a device that all workers have with --device"
            )


class _Process:
    """What the process keeps between tasks: its device, and what was made of one job."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._devices: dict[str | None, Device] = {}
        self._key = ""
        self._made: Any = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def device(self, spec: str | None) -> Device:
        """The device that a text names, opened once."""
        if spec not in self._devices:
            self._devices[spec] = open_device(spec)
        return self._devices[spec]

    def made(self, job: Job, make: Callable[[Scene], T]) -> T:
        """What `make` made of a job's scene when it was called for this job, unless another one
        came since. The scene's files last as long."""
        if self._made is None or self._key != job.key:
            self._made = self._folder = None  # its memory is needed
            self._folder = tempfile.TemporaryDirectory()
            self._made, self._key = make(job.scene(Path(self._folder.name))), job.key
        return self._made


_process = _Process()
#: What a task that needs a renderer calls to have it made for the first task of a job alone.
made = _process.made


def address() -> str:
    """Of the worker whose task this is."""
    from distributed import get_worker

    return get_worker().address


def run_task(
    call: Callable[[Device, Any, Any], T], device: str | None, thing: Any, item: Any,
    like: Place | None,
) -> tuple[Place, T]:  # fmt: skip
    """What `call` returns of a device, what is shared and an item; and where that was.

    Parameters
    ----------
    device : str or None        as for `furcl.render`
    like : Place or None        refuse to work on another kind of device than there

    Raises
    ------
    DeviceError                 another kind of device, or none
    """
    with _process.lock:
        try:
            opened = _process.device(device)
        except DeviceError as error:
            raise type(error)(f"worker {address()}: {error}") from None
        here = Place(
            address(), socket.gethostname(), opened.name, opened.platform,
            opened.driver_version, opened.is_cpu,
        )  # fmt: skip
        if like is not None:
            like.check(here)
        return here, call(opened, thing, item)
