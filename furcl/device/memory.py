"""Device buffers with their sizes counted."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager

import numpy as np
import pyopencl as cl
from numpy.typing import DTypeLike

from furcl.device.choice import Device
from furcl.device.forks import check_process
from furcl.errors import ResourceError


def fill(queue: cl.CommandQueue, buffer: cl.Buffer, value: int, n_bytes: int) -> None:
    """Set the first `n_bytes` of a buffer to a uint32, repeated."""
    cl.enqueue_fill_buffer(queue, buffer, np.array(value, np.uint32), 0, n_bytes)


class Memory:
    """Allocates buffers on one device and counts their bytes.

    Attributes
    ----------
    bytes : dict[str, int]      size of every buffer that is held, by name
    peak_bytes : int            most bytes that were held at a time
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self.bytes: dict[str, int] = {}
        self.peak_bytes = 0

    @property
    def total_bytes(self) -> int:
        """Bytes held on the device."""
        return sum(list(self.bytes.values()))  # one step: threads may add buffers

    def held(self, kind: str) -> int:
        """Bytes of the buffer of that name, and of those named "kind: ..."."""
        return sum(n for name, n in list(self.bytes.items()) if name.split(":")[0] == kind)

    @contextmanager
    def scratch(self) -> Iterator[Memory]:
        """Memory for buffers that nobody keeps after the with block; they count for the peak."""
        scratch = Memory(self.device)
        try:
            yield scratch
        finally:
            self.peak_bytes = max(self.peak_bytes, self.total_bytes + scratch.peak_bytes)

    def grow(self, name: str, buffer: cl.Buffer, n_bytes: int, zero: bool = False) -> cl.Buffer:
        """As `allocate`, for more than `buffer` of that name holds, which is copied and released.

        Raises
        ------
        ResourceError   if the device allows no buffer of that size
        """
        smaller = f"{name}, smaller"
        self.bytes[smaller] = self.bytes.pop(name)
        larger = self.allocate(name, n_bytes, zero)
        cl.enqueue_copy(self.device.queue, larger, buffer, byte_count=self.bytes[smaller])
        self.release(smaller, buffer)
        return larger

    def share(self, other: Memory, names: Collection[str]) -> None:
        """Count buffers that another memory of the same device has too, those of them that are
        there."""
        for name in other.bytes.keys() & set(names):
            self._count(name, other.bytes[name])

    def release(self, name: str, buffer: cl.Buffer) -> None:
        """Give a buffer back; commands that are under way may still use it."""
        del self.bytes[name]
        buffer.release()

    def _count(self, name: str, n_bytes: int) -> None:
        limit = self.device.max_allocation_bytes
        if n_bytes > limit:
            raise ResourceError(
                f"buffer {name!r} needs {n_bytes / 2**20:.0f} MiB, {self.device.name} allows "
                f"{limit / 2**20:.0f} MiB a buffer; use fewer segments or a smaller picture"
            )
        self.bytes[name] = n_bytes
        self.peak_bytes = max(self.peak_bytes, self.total_bytes)

    def upload(self, name: str, array: np.ndarray) -> cl.Buffer:
        """A read-only buffer holding a copy of `array` (any dtype, contiguous).

        Raises
        ------
        ResourceError   if the device allows no buffer of that size
        """
        array = np.ascontiguousarray(array)
        self._count(name, array.nbytes)
        flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
        # OpenCL knows no empty buffer.
        return cl.Buffer(self.device.context, flags, hostbuf=array if array.size else np.zeros(4))

    def allocate(self, name: str, n_bytes: int, zero: bool = False) -> cl.Buffer:
        """A read-write buffer; its content is undefined unless `zero`.

        Raises
        ------
        ResourceError   if the device allows no buffer of that size
        """
        self._count(name, n_bytes)
        buffer = cl.Buffer(self.device.context, cl.mem_flags.READ_WRITE, max(n_bytes, 16))
        if zero:
            fill(self.device.queue, buffer, 0, max(n_bytes, 16))
        return buffer

    def read(
        self,
        buffer: cl.Buffer,
        shape: tuple[int, ...] | int,
        dtype: DTypeLike = np.float32,
        offset: int = 0,
    ) -> np.ndarray:
        """Copy a part of a buffer back, from a byte on; waits for the queue."""
        check_process()
        out = np.empty(shape, dtype)
        cl.enqueue_copy(self.device.queue, out, buffer, src_offset=offset)
        return out
