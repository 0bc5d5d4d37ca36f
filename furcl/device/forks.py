"""Processes forked after OpenCL was used: its threads stayed behind, and waits never end."""

from __future__ import annotations

import os

from furcl.errors import DeviceError

_used_in: int | None = None


def mark_used() -> None:
    """Remember that this process uses OpenCL."""
    global _used_in
    _used_in = _used_in or os.getpid()


def check_process() -> None:
    """Refuse a process that was forked from one that had used OpenCL.

    Raises
    ------
    DeviceError
    """
    if _used_in not in (None, os.getpid()):
        raise DeviceError(
            "this process was forked after OpenCL was used, and OpenCL's threads stayed behind: it "
            "would wait for ever; fork before the first render, or start processes anew, as "
            "multiprocessing.get_context('spawn') does"
        )
