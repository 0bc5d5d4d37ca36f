"""What lets PoCL's compiler inline its own library into kernels."""

from __future__ import annotations

from furcl.device.choice import Device
from furcl.device.runtime_caches import POCL

# LLVM inlines a function only where all features of its target are allowed. PoCL's library for
# AVX-512 is built for servers, which have this instruction; the processors of desktops
# (Rocket Lake, Ice Lake) have not, and every fma() would be a call. No compiler emits it unasked.
_FEATURE = "clwb"
_AVX512_FLOATS = 16


def with_library_features(device: Device, text: str) -> str:
    """The text of a program for a device: on PoCL with AVX-512 its functions are allowed all that
    PoCL's library is built for; elsewhere it stays as it is."""
    wide = device.is_cpu and device.cl_device.native_vector_width_float == _AVX512_FLOATS
    if not (wide and device.platform.startswith(POCL)):
        return text
    allow = (
        f'#pragma clang attribute push(__attribute__((target("{_FEATURE}"))), apply_to=function)'
    )
    return f"{allow}\n{text}\n#pragma clang attribute pop\n"
