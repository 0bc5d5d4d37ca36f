"""Which things work-items take: each once, and about as many in any part of a launch."""

import numpy as np
import pyopencl as cl
import pytest
from kernel_harness import built

from furcl.device import layout
from furcl.device.features import Features
from furcl.device.memory import Memory
from furcl.device.source import expand

KERNEL = """
__kernel void shares(const uint n, __global uint* first)
{
    first[get_global_id(0)] = first_of_item(n, PER_ITEM);
}
"""
# Things, work-items and things an item: launches that fit, that are too large, and tiny ones.
LAUNCHES = [
    (32768, 256, 128), (13000, 256, 128), (129, 256, 128), (128, 256, 128), (1, 256, 128),
    (0, 256, 128), (5, 1, 8), (1000, 1000, 32), (31999, 1000, 32), (77, 1000, 32), (64, 7, 10),
    (1 << 30, 1 << 23, 128), (3 << 28, 1 << 23, 128),
]  # fmt: skip


def firsts(device, n, n_items, per_item, mistake=("", "")):
    """Where each of the work-items of a launch begins, (n_items,)."""
    text = f"#define PER_ITEM {per_item}u\n" + expand("core/shares.clh", Features()) + KERNEL
    assert mistake[0] in text
    text = text.replace(*mistake)
    program = built(device, layout.declarations(text, Features(), {}) + text)
    memory = Memory(device)
    first = memory.allocate("first", 4 * n_items)
    cl.Kernel(program, "shares")(device.queue, (n_items,), None, np.uint32(n), first)
    return memory.read(first, n_items, np.uint32)


def check(first, n, per_item):
    """Each thing is taken once; of any run of work-items as many take some as of all, to one."""
    takes = first < n
    np.testing.assert_array_equal(first[takes], np.arange(0, n, per_item))
    surplus = np.concatenate([[0], np.cumsum(takes - takes.mean())])
    assert np.ptp(surplus) <= 1.0 + 1e-6


@pytest.mark.parametrize("launch", LAUNCHES, ids=str)
def test_things_are_spread_over_the_launch(device, launch):
    n, n_items, per_item = launch
    check(firsts(device, n, n_items, per_item), n, per_item)


@pytest.mark.parametrize(
    "mistake",
    [
        ("(uint)(item * n_shares / n_items);", "item; if (1) return share * per_item;"),
        ("n_items > share ?", "n_items >= share ?"),
        ("(n + per_item - 1u) / per_item", "n / per_item"),
        ("const ulong n_items", "const uint n_items"),
    ],
    ids=["the first take all", "all take some", "the last are lost", "too few bits"],
)
def test_mistakes_are_seen(device, mistake):
    seen = 0
    for n, n_items, per_item in LAUNCHES:
        try:
            check(firsts(device, n, n_items, per_item, mistake), n, per_item)
        except AssertionError:
            seen += 1
    assert seen > 0


@pytest.mark.parametrize("n", [0, 5, 1000])
def test_one_thing_each_goes_to_neighbours(device, n):
    np.testing.assert_array_equal(firsts(device, n, 1000, 1), np.arange(1000))
