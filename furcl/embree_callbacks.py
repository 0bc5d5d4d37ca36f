"""Native callbacks of Embree's tree builder, called from its own threads.

The tree goes to arrays whose addresses are in the user pointer: [node counter, children, bounds].
The "pointers" that the builder hands around are numbers: 4 i + 2 for node i, 4 i + 3 for
primitive i.
"""

import numba
from numba import types

from furcl.native import atomic_add, floats_at, numbers_at, words_at

NODE_TAG, LEAF_TAG = 2, 3

_pointers = types.CPointer(types.intp)


@numba.cfunc(types.intp(types.voidptr, types.uint32, types.intp), cache=True)
def create_node(allocator, child_count, user):
    """Number a new node."""
    return 4 * atomic_add(user, 1) + NODE_TAG


@numba.cfunc(types.void(types.intp, _pointers, types.uint32, types.intp), cache=True)
def set_node_children(node, children, child_count, user):
    """Store the two children of a node: an index, or the complement of a primitive's number."""
    out = words_at(numbers_at(user, 3)[1] + (node >> 2) * 8, 2)
    for i in range(2):
        child = children[i]
        out[i] = ~(child >> 2) if child & 1 else child >> 2


@numba.cfunc(types.void(types.intp, _pointers, types.uint32, types.intp), cache=True)
def set_node_bounds(node, bounds, child_count, user):
    """Copy the boxes of the two children."""
    out = floats_at(numbers_at(user, 3)[2] + (node >> 2) * 64, 16)
    for i in range(2):
        box = floats_at(bounds[i], 8)
        for k in range(8):
            out[8 * i + k] = box[k]


@numba.cfunc(
    types.intp(types.voidptr, types.CPointer(types.uint32), types.uintp, types.intp), cache=True
)
def create_leaf(allocator, primitives, count, user):
    """Name a leaf by the number of its only primitive."""
    return 4 * types.intp(primitives[7]) + LEAF_TAG
