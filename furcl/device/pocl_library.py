"""What lets PoCL's compiler take wide vectors, and inline its own library into kernels."""

from __future__ import annotations

from furcl.device.choice import Device
from furcl.device.runtime_caches import POCL

# Without AVX-512 a float16 is handed over otherwise than with it, of which Clang warns. All of a
# program and PoCL's library are compiled for one processor, so that nothing disagrees.
#
# LLVM inlines a function only where all features of its target are allowed, and where they are not
# every fma() is a call. PoCL's library for AVX-512 is built for servers, which have CLWB; the
# processors of desktops (Rocket Lake, Ice Lake) have not, and no compiler emits it unasked. The one
# for AVX2 is built for Haswell, which LLVM, but not of AMD's processors, says has fast `rep movsb`;
# for that Clang knows no name, so functions are compiled for that processor.
_BEFORE = """\
#pragma clang diagnostic ignored "-Wpsabi"
#if defined(__AVX512F__)
#pragma clang attribute push(__attribute__((target("clwb"))), apply_to=function)
#elif defined(__AVX2__)
#pragma clang attribute push(__attribute__((target("arch=haswell"))), apply_to=function)
#endif
"""
_AFTER = """
#if defined(__AVX2__)
#pragma clang attribute pop
#endif
"""


def for_compiler(device: Device, text: str) -> str:
    """The text of a program as a device's compiler wants it; only PoCL's wants something.

    Its functions may hand over vectors wider than the processor's, and are allowed all that PoCL's
    library is built for.
    """
    return _BEFORE + text + _AFTER if device.platform.startswith(POCL) else text
