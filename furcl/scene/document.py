"""TOML text as a document, within limits that scenes keep and damaged files do not.

Python's reader of TOML goes down with every bracket and copies every part of a dotted key: a text
of some kilobytes can take it minutes, or its whole stack.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

MAX_BYTES = 1 << 20
MAX_DEPTH = 32

# What has no structure inside: texts and comments. A text without an end is left alone.
_OPAQUE = re.compile(
    "|".join(
        [
            r'"""(?:[^\\]|\\.)*?"""',
            r"'''.*?'''",
            r'"(?:[^"\\\n]|\\.)*"',
            r"'[^'\n]*'",
            r"#[^\n]*",
        ]
    ),
    re.DOTALL,
)
_LONG_KEY = re.compile(rf"(?<![\w-])(?:[\w-]+[ \t]*\.[ \t]*){{{MAX_DEPTH},}}")


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises
    ------
    ValueError      no TOML, larger than MAX_BYTES, deeper than MAX_DEPTH, or with a number that is
                    too long; says where or which
    """
    if len(text) > MAX_BYTES:
        raise ValueError(f"{len(text)} characters; at most {MAX_BYTES} are read")
    _check_depth(text)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("tables or lists are nested too deeply") from None


def _check_depth(text: str) -> None:
    bare = _OPAQUE.sub("_", text)
    long = _LONG_KEY.search(bare)
    if long:
        line = bare.count("\n", 0, long.start()) + 1
        raise ValueError(f"a dotted key of more than {MAX_DEPTH} parts (about line {line})")
    depth = 0
    for found in re.finditer(r"[\[{\]}]", bare):
        depth = depth + 1 if found[0] in "[{" else max(depth - 1, 0)
        if depth > MAX_DEPTH:
            line = bare.count("\n", 0, found.start()) + 1
            raise ValueError(f"brackets are nested {depth} deep (about line {line})")
