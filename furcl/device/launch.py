"""Sizes of kernel launches."""

from __future__ import annotations

#: Work-items in a group, unless a kernel asks for another number. One for every launch: CPU
#: runtimes compile a kernel anew for each size.
LOCAL_SIZE = 64


def grid(n: int, per_item: int = 1, local: int = LOCAL_SIZE) -> tuple[tuple[int], tuple[int]]:
    """Global and local size of a launch over `n` things, of which a work-item takes `per_item`.

    Groups are whole, and there is at least one: kernels leave out what is beyond `n`.
    """
    groups = -(-n // (per_item * local))
    return (max(groups, 1) * local,), (local,)
