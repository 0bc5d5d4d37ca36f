"""Kernels with a typical mistake in their text, which tests must see."""

from __future__ import annotations

import re

import pytest

from furcl.device import program


def substitute(monkeypatch: pytest.MonkeyPatch, pattern: str, text: str, within: str) -> None:
    """Compile kernels with `text` in place of what a regular expression matches.

    Programs of which the file `within` is a part must hold exactly one match, in a header that may
    be included more than once.
    """
    source = program.kernel_text

    def mutated(names, *arguments, **keywords) -> str:
        whole = source(names, *arguments, **keywords)
        pieces = set(re.split(r"^(?=#line )", whole, flags=re.MULTILINE))
        count = sum(len(re.findall(pattern, piece)) for piece in pieces)
        found = re.sub(pattern, text, whole)
        files = [names] if isinstance(names, str) else names
        assert within not in files or count == 1, f"{pattern}: {count} matches in {within}"
        return found

    monkeypatch.setattr(program, "kernel_text", mutated)
