"""Small helpers compiled by numba for code that calls a C library: addresses, atomic counters.

Everything here can be cached on disk by numba, because no address is a compile-time constant.
"""

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.numpy_support import carray


def _intrinsic(function) -> Any:
    """numba's intrinsic; its callers leave out the first parameter, which type checkers miss."""
    return intrinsic(function)


@_intrinsic
def as_pointer(typingctx, address):
    """Turn an integer address into a ``void *``."""
    signature = types.voidptr(types.intp)

    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return signature, codegen


@_intrinsic
def atomic_add(typingctx, address, value):
    """Add ``value`` to the 64-bit integer at ``address``; returns what was there before."""
    signature = types.int64(types.intp, types.int64)

    def codegen(context, builder, signature, args):
        pointer = builder.inttoptr(args[0], ir.IntType(64).as_pointer())
        return builder.atomic_rmw("add", pointer, args[1], "monotonic")

    return signature, codegen


@_intrinsic
def call_query(typingctx, function, scene, ray, arguments):
    """Call ``void function(scene, ray, arguments)``; all four are integer addresses."""
    signature = types.void(types.intp, types.intp, types.intp, types.intp)

    def codegen(context, builder, signature, args):
        pointers = [builder.inttoptr(arg, cgutils.voidptr_t) for arg in args[1:]]
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t] * 3)
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), pointers)
        return context.get_dummy_value()

    return signature, codegen


@numba.njit(cache=True)
def floats_at(address, n):
    """The `n` float32 at an address, as an array."""
    return carray(as_pointer(address), (n,), np.float32)


@numba.njit(cache=True)
def words_at(address, n):
    """The `n` uint32 at an address, as an array."""
    return carray(as_pointer(address), (n,), np.uint32)
