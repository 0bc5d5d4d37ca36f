"""Index checks of debug builds (Features.debug, FURCL_DEBUG=1): the records that kernels write.

A buffer that is watched has a record in its last words, behind its contents, where
kernels/include/core/prelude.clh writes the first index that is outside its range.
"""

from __future__ import annotations

import numpy as np
import pyopencl as cl

from furcl.device import layout
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.errors import KernelIndexError

RECORD_BYTES = 4 * layout.CHECK_WORDS


def upload(memory: Memory, name: str, array: np.ndarray, debug: bool) -> cl.Buffer:
    """A buffer holding a copy of `array`; in a debug build with room for a record behind it, which
    kernels may write.

    Raises
    ------
    ResourceError   if the device allows no buffer of that size
    """
    if not debug:
        return memory.upload(name, array)
    array = np.ascontiguousarray(array)
    buffer = memory.allocate(name, array.nbytes + RECORD_BYTES, zero=True)
    if array.size:
        cl.enqueue_copy(memory.device.queue, buffer, array)
    return buffer


class IndexChecks:
    """The records of the buffers that a program uses.

    Parameters
    ----------
    queue : CommandQueue
    features : Features         nothing is done unless they have debug
    """

    def __init__(self, queue: cl.CommandQueue, features: Features) -> None:
        self.enabled = features.debug
        self._queue = queue
        self._empty: dict[cl.Buffer, np.ndarray] = {}

    def watch(self, buffer: cl.Buffer, **sizes: int) -> None:
        """Write an empty record into the last RECORD_BYTES of a buffer, with sizes that kernels
        compare with: `n_vertices=5` is the word CHECK_N_VERTICES of furcl.device.layout."""
        if self.enabled:
            empty = np.zeros(layout.CHECK_WORDS, np.uint32)
            for name, size in sizes.items():
                empty[getattr(layout, f"CHECK_{name.upper()}")] = size
            self._empty[buffer] = empty
            self._clear(buffer)

    def forget(self, buffer: cl.Buffer) -> None:
        """Watch a buffer no more."""
        self._empty.pop(buffer, None)

    def check(self, kernel: str) -> None:
        """Wait for the kernel launched last.

        Raises
        ------
        KernelIndexError    if it used an index outside its range: kernel, file, line, index, size
        """
        for buffer in self._empty:
            self._check(buffer, kernel)

    def _clear(self, buffer: cl.Buffer) -> None:
        at = buffer.size - RECORD_BYTES
        cl.enqueue_copy(self._queue, buffer, self._empty[buffer], dst_offset=at)

    def _check(self, buffer: cl.Buffer, kernel: str) -> None:
        found = np.empty(layout.CHECK_WORDS, np.uint32)
        cl.enqueue_copy(self._queue, found, buffer, src_offset=buffer.size - RECORD_BYTES)
        failures = int(found[layout.CHECK_FAILURES])
        if not failures:
            return
        self._clear(buffer)
        file = found[layout.CHECK_FILE :].tobytes().split(b"\0")[0].decode()
        raise KernelIndexError(
            f"kernel {kernel}, {file}:{found[layout.CHECK_LINE]}: index "
            f"{found[layout.CHECK_INDEX]} - allowed is below {found[layout.CHECK_SIZE]} - "
            f"{failures} such accesses in this launch; this is a fault of furcl: report it with "
            f"the scene"
        )
