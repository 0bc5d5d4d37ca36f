"""Kernels with a typical mistake in their text, which tests must see."""

from __future__ import annotations

import re

import pytest

from furcl.device import program


def substitute(
    monkeypatch: pytest.MonkeyPatch, pattern: str, text: str, within: str, header: str = ""
) -> None:
    """Compile kernels with `text` in place of what a regular expression matches.

    Programs of which the file `within` is a part must hold exactly one match, in a header that may
    be included more than once. `header` ends the name of the one that is meant where others match.
    """
    source = program.kernel_text

    def mutated(names, *arguments, **keywords) -> str:
        whole = source(names, *arguments, **keywords)
        pieces = re.split(r"^(?=#line )", whole, flags=re.MULTILINE)
        meant = {piece for piece in pieces if piece.partition("\n")[0].endswith(f'{header}"')}
        count = sum(len(re.findall(pattern, piece)) for piece in meant)
        found = "".join(re.sub(pattern, text, p) if p in meant else p for p in pieces)
        files = [names] if isinstance(names, str) else names
        assert within not in files or count == 1, f"{pattern}: {count} matches in {within}"
        return found

    monkeypatch.setattr(program, "kernel_text", mutated)
