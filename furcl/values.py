"""Values that callers and files give: how messages show them, and whether they are numbers."""

from __future__ import annotations

import numbers
import reprlib
from typing import Any

LONGEST_SHOWN = 80

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = LONGEST_SHOWN


def shown(value: object) -> str:
    """A value as messages show it: its repr, at most about LONGEST_SHOWN characters of it.

    Whatever it is: integers too long for Python to spell, texts that no encoding takes.
    """
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 256:
        return f"a whole number of {value.bit_length()} bits"
    try:
        text = repr(value)
        if len(text) > LONGEST_SHOWN:
            text = _short.repr(value)
    except Exception:  # a value's own repr may do anything
        text = f"<{type(value).__name__}>"
    if len(text) > 2 * LONGEST_SHOWN:
        text = f"{text[:LONGEST_SHOWN]} ... ({len(text)} characters)"
    return text.encode("utf-8", "backslashreplace").decode()


def printable(text: str) -> str:
    """A text with escapes in place of what no line can show: breaks, other controls, and bytes of
    file names that are no text."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def is_number(value: Any) -> bool:
    """Whether a value is a real number, of Python or numpy; True and False are none."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def is_whole(value: Any) -> bool:
    """Whether a value is an integer, of Python or numpy; True and False are none."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)
