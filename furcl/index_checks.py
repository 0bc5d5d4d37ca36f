"""Index checks of debug builds (Features.debug, FURCL_DEBUG=1): the record that kernels write."""

from __future__ import annotations

import numpy as np
import pyopencl as cl

from furcl import layout
from furcl.errors import KernelIndexError
from furcl.features import Features


class IndexChecks:
    """The record behind the planes of the path state (kernels/include/index_checks.clh).

    Parameters
    ----------
    queue : CommandQueue
    features : Features         nothing is done unless they have debug
    wave_size : int             slots of the state
    n_vertices : int            of the groom
    """

    def __init__(
        self, queue: cl.CommandQueue, features: Features, wave_size: int, n_vertices: int
    ) -> None:
        self.enabled = features.debug
        self._queue = queue
        self._at = 4 * len(layout.planes(features)) * wave_size
        self._record = np.zeros(layout.CHECK_WORDS, np.uint32)
        self._record[layout.CHECK_N_VERTICES] = n_vertices

    @property
    def n_bytes(self) -> int:
        """Bytes that the record takes behind the state's planes."""
        return 4 * layout.CHECK_WORDS if self.enabled else 0

    def clear(self, state: cl.Buffer) -> None:
        """Write an empty record."""
        if self.enabled:
            cl.enqueue_copy(self._queue, state, self._record, dst_offset=self._at)

    def check(self, state: cl.Buffer, kernel: str) -> None:
        """Wait for the kernel launched last.

        Raises
        ------
        KernelIndexError    if it used an index outside its buffer: kernel, file, line, index, size
        """
        if not self.enabled:
            return
        found = np.empty_like(self._record)
        cl.enqueue_copy(self._queue, found, state, src_offset=self._at)
        failures = int(found[layout.CHECK_FAILURES])
        if not failures:
            return
        self.clear(state)
        file = found[layout.CHECK_FILE :].tobytes().split(b"\0")[0].decode()
        raise KernelIndexError(
            f"kernel {kernel}, {file}:{found[layout.CHECK_LINE]}: index "
            f"{found[layout.CHECK_INDEX]} - allowed is below {found[layout.CHECK_SIZE]} - "
            f"{failures} such accesses in this launch; this is a fault of furcl: report it with "
            f"the scene"
        )
