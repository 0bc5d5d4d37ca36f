"""The workers of a cluster that share a benchmark: all have one kind of device."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from furcl.bench.record import command, place
from furcl.device.choice import Device
from furcl.distributed.tasks import Shared, Workers, connected
from furcl.errors import DeviceError

if TYPE_CHECKING:
    from distributed import Client

Found = dict[str, Any]
"""Values for JSON."""


@contextmanager
def workers_of(
    client: Client | str, device: str | Device | None
) -> Iterator[tuple[Workers, Found]]:
    """The workers of a cluster, and what `furcl.bench.record.circumstances` would say on the first
    that answers. Those that are there have been asked for their device.

    Parameters
    ----------
    client : Client or text     of the cluster, or the address of its scheduler
    device : str or None        on each worker, as for `furcl.render`

    Raises
    ------
    DeviceError     as `connected` and `Shared`; no device, or devices of two kinds
    """
    if isinstance(device, Device):
        raise DeviceError(
            f"device = {device.name}, opened here: workers open their own; give its name as text"
        )
    with connected(client) as cluster:
        workers = Workers(cluster, device, one_kind=True)
        # As many tasks as workers: one that has nothing to do is given the next.
        asked = range(max(workers.number(), 1))
        answers = Shared(workers, None).results(_place, asked, lambda _: "asking for devices")
        places = [found for _, found in answers]
        yield workers, {**command(), **places[0]}


def _place(device: Device, _thing: None, _item: int) -> Found:
    return place(device)
