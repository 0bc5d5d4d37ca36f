"""What lets PoCL's compiler take wide vectors, and inline its own library into kernels."""

from __future__ import annotations

from furcl.device.choice import Device
from furcl.device.runtime_caches import POCL

# LLVM inlines a function only where all features of its target are allowed. PoCL's library for
# AVX-512 is built for servers, which have this instruction; the processors of desktops
# (Rocket Lake, Ice Lake) have not, and every fma() would be a call. No compiler emits it unasked.
_FEATURE = "clwb"
_AVX512_FLOATS = 16

# Without AVX-512 a float16 is handed over otherwise than with it, of which Clang warns. All of a
# program and PoCL's library are compiled for one processor, so that nothing disagrees.
_HANDING_OVER = '#pragma clang diagnostic ignored "-Wpsabi"'


def for_compiler(device: Device, text: str) -> str:
    """The text of a program as a device's compiler wants it; only PoCL's wants something.

    With AVX-512 its functions are allowed all that PoCL's library is built for, without it they
    may hand over vectors wider than the processor's.
    """
    if not device.platform.startswith(POCL):
        return text
    if device.cl_device.native_vector_width_float != _AVX512_FLOATS:
        return f"{_HANDING_OVER}\n{text}"
    allow = (
        f'#pragma clang attribute push(__attribute__((target("{_FEATURE}"))), apply_to=function)'
    )
    return f"{allow}\n{text}\n#pragma clang attribute pop\n"
