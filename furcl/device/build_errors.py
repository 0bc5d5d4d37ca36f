"""What a failed build of a kernel says, and whether the kernel is to blame."""

from __future__ import annotations

import re

#: In every KernelBuildError.
DOES_NOT_COMPILE = "does not compile"

# As clang and NVIDIA's compiler say it, and as PoCL turns clang's round.
_PLACE = re.compile(r":\d+(:\d+)?: (fatal )?error|error: [^:\n]+:\d+(:\d+)?:")


def names_a_place(said: str) -> bool:
    """Whether a compiler's message names a line of the text that it does not take."""
    return _PLACE.search(said) is not None
