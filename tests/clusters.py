"""Clusters of this machine, and what tests do to their workers."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from furcl.device.choice import Device, list_candidates


@contextmanager
def local_cluster(n_workers: int = 2) -> Iterator[Any]:
    """The client of a cluster of processes with one thread each; skips where Dask is not there."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=n_workers, threads_per_worker=1, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def spec_of(device: Device) -> str:
    """The text that names a device to workers on this machine."""
    return str(next(c.index for c in list_candidates() if c.name == device.name))


def workers_of(client: Any) -> list[str]:
    """Addresses of the workers."""
    return list(client.scheduler_info(n_workers=-1)["workers"])


class Kill:
    """A progress function that ends workers without a word when a share of the work is done."""

    def __init__(self, client: Any, most: int, share: float = 0.0) -> None:
        self.client, self.most, self.share = client, most, share
        self.killed: list[int] = []

    def __call__(self, done: int, total: int) -> bool:
        self.when(done, total)
        return False

    def when(self, done: int, total: int) -> None:
        """End them if it is time."""
        if done > self.share * total and not self.killed:
            chosen = workers_of(self.client)[: self.most]
            self.killed.extend(self.client.run(os.getpid, workers=chosen).values())
            for pid in self.killed:
                os.kill(pid, signal.SIGKILL)
