"""Directives of pbrt scene files, read block by block, with the files that they include."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from furcl.errors import GroomError
from furcl.files import check_regular
from furcl.values import shown

BLOCK_LETTERS = 1 << 20
#: Longer strings and lists are none of a curve.
LONGEST_TOKEN = 1 << 24
MOST_ARGUMENTS = 10_000
DEEPEST_INCLUDE = 16
_TOKEN = re.compile(r'#[^\n]*\n?|"[^"\n]*"?|\[[^\]]*\]?|[^\s\[\]"#]+|\]')
_WORD = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class Directive:
    """A directive, such as Shape, with its arguments as they are written.

    Attributes
    ----------
    name : str
    arguments : list of str     numbers, "strings" with their quotes, [lists] with their brackets
    path : Path                 the file that it is in
    line : int                  its line there, from 1
    """

    name: str
    arguments: list[str]
    path: Path
    line: int

    @property
    def where(self) -> str:
        """How messages name the place."""
        return f"{self.path}: line {self.line}"


def directives(path: Path, folder: Path | None = None, depth: int = 0) -> Iterator[Directive]:
    """The directives of a file and of those that it includes, in order.

    Raises
    ------
    GroomError      the line, and what is wrong there
    """
    folder = folder or path.parent
    name, arguments, began = "", [], 0
    for token, line in _tokens(path):
        if token[0] in '"[' or not _WORD.match(token):
            if not name:
                raise GroomError(
                    f"{path}: line {line}: {shown(token)} stands before any directive; is it a "
                    "pbrt scene?"
                )
            arguments.append(token)
            if len(arguments) > MOST_ARGUMENTS:
                raise GroomError(
                    f"{path}: line {line}: {name} has more than {MOST_ARGUMENTS} arguments; "
                    "numbers of an array stand in [ ]. Repair the file."
                )
            continue
        if name:
            yield from _included(Directive(name, arguments, path, began), folder, depth)
        name, arguments, began = token, [], line
    if name:
        yield from _included(Directive(name, arguments, path, began), folder, depth)


def _included(directive: Directive, folder: Path, depth: int) -> Iterator[Directive]:
    if directive.name not in ("Include", "Import"):
        yield directive
        return
    if len(directive.arguments) != 1 or directive.arguments[0][:1] != '"':
        raise GroomError(f'{directive.where}: {directive.name} wants one "FILE". Repair the file.')
    if depth >= DEEPEST_INCLUDE:
        raise GroomError(
            f"{directive.where}: files include each other {DEEPEST_INCLUDE} deep; does one include "
            "itself?"
        )
    name = directive.arguments[0].strip('"')
    inner = folder / name
    try:
        if not inner.exists():
            inner = directive.path.parent / name
        check_regular(inner)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise GroomError(
            f"{directive.where}: {directive.name} {shown(name)}: {reason}. Put the file beside the "
            "scene, or remove the line."
        ) from None
    yield from directives(inner, folder, depth + 1)


def _tokens(path: Path) -> Iterator[tuple[str, int]]:
    """Tokens and their lines; comments are left out."""
    packed = path.name.lower().endswith(".gz")
    rest, line = "", 1
    with gzip.open(path, "rb") if packed else path.open("rb") as file:
        while True:
            try:
                block = file.read(BLOCK_LETTERS).decode("latin-1")
            except (EOFError, zlib.error, gzip.BadGzipFile) as error:
                raise GroomError(
                    f"{path}: cannot be unpacked: {error}. It is cut off or no gzip file; fetch it "
                    "again."
                ) from None
            text, at, counted = rest + block, 0, 0
            for found in _TOKEN.finditer(text):
                token = found[0]
                if block and found.end() == len(text):
                    break  # may go on in the next block
                line += text.count("\n", counted, found.start())
                counted = at = found.end()
                inside = token.count("\n")
                if token[0] != "#":
                    _check_closed(token, path, line)
                    yield token, line
                line += inside
            else:
                at = len(text)
            rest = text[at:]
            line += text.count("\n", counted, at)
            if len(rest) > LONGEST_TOKEN:
                raise GroomError(
                    f"{path}: line {line}: {shown(rest[:40])} does not end within {LONGEST_TOKEN} "
                    "letters; repair the file."
                )
            if not block:
                return


def _check_closed(token: str, path: Path, line: int) -> None:
    closed = len(token) > 1 and token[-1] == token[0] if token[0] == '"' else token[-1] == "]"
    if token == "]" or (token[0] in '"[' and not closed):
        raise GroomError(
            f"{path}: line {line}: {shown(token)} is not opened and closed; repair the file, or "
            "is it cut off?"
        )
