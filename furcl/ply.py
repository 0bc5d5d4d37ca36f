"""Headers of Stanford PLY files, read before there are arrays."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from furcl.errors import FurclError
from furcl.values import shown

HEADER_BYTES = 1 << 16


@dataclass(frozen=True, eq=False)
class Element:
    """A table of the file: its name, its rows, and the name of each property and whether that is
    a list."""

    name: str
    count: int
    properties: list[tuple[str, bool]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Header:
    """The elements in the order of the file, how many lines say them, and whether it is text."""

    elements: list[Element]
    n_lines: int
    is_text: bool


def read_header(path: Path, error: type[FurclError]) -> Header:
    """The header of a file.

    Raises
    ------
    error       what is no PLY; counts that the file cannot hold
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(HEADER_BYTES)
    if head[:3] != b"ply":
        raise error(f"{path}: begins with {head[:3]!r}; a PLY begins with b'ply'. Is it one?")
    head, found, _ = head.partition(b"end_header")
    if not found:
        raise error(
            f"{path}: no end_header in its first {HEADER_BYTES} bytes; it is cut off or damaged, "
            "export it again."
        )
    elements: list[Element] = []
    is_text = False
    lines = head.decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    for number, line in enumerate(lines, 1):
        words = line.split()
        if words[:1] == ["format"]:
            is_text = "ascii" in words
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdecimal():
            elements.append(Element(words[1], int(words[2][:20])))
        elif words[:1] == ["property"] and elements and len(words) in (3, 5):
            elements[-1].properties.append((words[-1], len(words) == 5))
        elif words[:1] in (["element"], ["property"]):
            raise error(
                f"{path}: line {number} is {shown(line)}; expected 'element NAME COUNT', or below "
                "it 'property TYPE NAME' or 'property list TYPE TYPE NAME'. Export it again."
            )
    for element in elements:
        # A number takes at least a byte, or a digit and a space.
        if element.count * max(len(element.properties), 1) > size:
            raise error(
                f"{path}: its header claims {element.count} rows of {len(element.properties)} "
                f"numbers in a file of {size} bytes; it is cut off or damaged, export it again."
            )
    return Header(elements, len(lines), is_text)
