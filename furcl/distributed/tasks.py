"""Work that the workers of a Dask cluster share: tasks, and one thing that all of them need."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from furcl.device.choice import Device
from furcl.distributed.worker import Place, run_task
from furcl.errors import DeviceError
from furcl.values import shown

if TYPE_CHECKING:
    from distributed import Client

log = logging.getLogger(__name__)

T = TypeVar("T")
Item = TypeVar("Item")
Result = TypeVar("Result")

#: How often what is shared may be lost with all workers that had it while no task is done.
LOSSES = 5
#: Between two questions whether to stop while nothing comes [s].
POLL_S = 0.05


@contextmanager
def connected(client: Client | str) -> Iterator[Client]:
    """The client of a cluster; of the address of a scheduler one that is closed at the end.

    Raises
    ------
    DeviceError     dask.distributed is not installed, no scheduler answers, or it is neither
    """
    try:
        from distributed import Client
    except ImportError:
        raise DeviceError(
            "work on a cluster needs the package distributed; install it with "
            "pip install 'furcl[cluster]'"
        ) from None
    if isinstance(client, Client):
        yield client
        return
    if not isinstance(client, str):
        raise DeviceError(
            f"client = {shown(client)}: expected a distributed.Client, or the address of a "
            f"scheduler, such as tcp://HOST:8786"
        )
    try:
        own = Client(client)
    except (OSError, ValueError) as error:
        raise DeviceError(f"--dask {client}: no scheduler answers there: {error}") from None
    with own:
        yield own


class Workers:
    """The workers of a cluster.

    Parameters
    ----------
    client : Client
    device : str or None    on each worker, as for `furcl.render`
    one_kind : bool         refuse workers whose devices differ from that of the first

    Attributes
    ----------
    places : dict           address -> Place, of those that have done a task
    """

    def __init__(self, client: Client, device: str | None, *, one_kind: bool) -> None:
        self.client, self.device, self.one_kind = client, device, one_kind
        self.places: dict[str, Place] = {}

    @property
    def like(self) -> Place | None:
        """A place whose kind of device all have to have; None where any will do, or before the
        first task is done."""
        return next(iter(self.places.values()), None) if self.one_kind else None

    def number(self) -> int:
        """How many the scheduler knows now."""
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    def note(self, place: Place) -> None:
        """A task was done there.

        Raises
        ------
        DeviceError     another kind of device
        """
        if self.like is not None:
            self.like.check(place)
        if place.worker in self.places:
            return
        beside = [p.worker for p in self.places.values() if p.host == place.host]
        if self.one_kind and place.is_cpu and beside:
            log.warning(
                "workers %s and %s share the processor of %s: each is slower than alone",
                beside[0], place.worker, place.host,
            )  # fmt: skip
        self.places[place.worker] = place


class Shared(Generic[T]):
    """Something that tasks need, sent to each worker once, and again where it was lost with them.

    Parameters
    ----------
    workers : Workers
    thing : T

    Raises
    ------
    DeviceError     there is no worker
    """

    def __init__(self, workers: Workers, thing: T) -> None:
        self.workers, self.thing = workers, thing
        self._losses = self._sending = 0
        self._sent = self._send()

    def results(
        self,
        call: Callable[[Device, T, Item], Result],
        items: Sequence[Item],
        name: Callable[[Item], str],
        *,
        twice: bool = False,
        idle: Callable[[], bool] | None = None,
    ) -> Generator[tuple[Item, Result], None, None]:
        """The items with what `call` returns of the worker's device, the thing and an item, in the
        order in which they are ready. A lost worker costs what it worked on, which others take.

        Parameters
        ----------
        call : callable             pickled by its name
        items : sequence            begun in this order
        name : callable             of an item, for messages
        twice : bool                workers that have nothing to do take what others are not ready
                                    with, and the first of both counts
        idle : callable or None     asked often while nothing is ready; true ends the iteration

        Raises
        ------
        DeviceError     an item was lost with more workers than the scheduler allows
                        (distributed.scheduler.allowed-failures), the thing with all workers that
                        had it, LOSSES times without an item between, or devices of two kinds where
                        one is asked for
        Exception       of the first `call` that fails
        """
        from distributed import CancelledError, KilledWorker, as_completed

        client, left = self.workers.client, set(range(len(items)))
        coming, tasks = as_completed(loop=client.loop), {}

        def begin(index: int, again: bool = False) -> None:
            task = client.submit(
                run_task, call, self.workers.device, self._sent, items[index], self.workers.like,
                pure=False, priority=-index - (len(items) if again else 0),
            )  # fmt: skip
            tasks[task] = index, self._sending
            coming.add(task)

        try:
            for index in range(len(items)):
                begin(index)
            while left and _ready(coming, idle):
                task = next(coming)
                index, sending = tasks.pop(task)
                if index not in left:
                    continue
                try:
                    place, result = task.result()
                except KilledWorker as error:
                    raise DeviceError(f"{name(items[index])}: {error}") from None
                except CancelledError as error:
                    # Tasks go with the thing that they were given.
                    if sending == self._sending:
                        self._send_again(name(items[index]), error)
                    begin(index)
                    continue
                left.remove(index)
                self._losses = 0
                self.workers.note(place)
                yield items[index], result
                if twice and len(tasks) == len(left) <= self.workers.number() // 2:
                    for late in sorted(left):
                        begin(late, again=True)
        finally:
            client.cancel(list(tasks))

    def _send(self) -> Any:
        """A future of the thing, on the workers that are there."""
        try:
            return self.workers.client.scatter(self.thing, broadcast=True, hash=False)
        except TimeoutError:
            raise DeviceError(
                "the cluster has no worker: start some by dask worker ADDRESS, with furcl installed"
            ) from None

    def _send_again(self, lost: str, error: Exception) -> None:
        self._losses += 1
        if self._losses > LOSSES:
            raise DeviceError(
                f"{lost}: lost {self._losses} times with all workers that could do it, which ended "
                f"or were ended: {error}; their logs say why"
            ) from None
        self._sent, self._sending = self._send(), self._sending + 1


def _ready(coming: Any, idle: Callable[[], bool] | None) -> bool:
    """Wait until a task is done; false where `idle` says to wait no longer."""
    while idle is not None and not coming.has_ready():
        if idle():
            return False
        time.sleep(POLL_S)
    return True
