"""What docstrings of tables say of their keys."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass

Limits = tuple[float, float]


@dataclass(frozen=True)
class Meaning:
    """What a docstring says of a key: text, unit, and the range if it states one."""

    text: str
    unit: str
    limits: Limits | None


def meanings(docstring: str | None) -> dict[str, Meaning]:
    """Name -> meaning, of the lines of the sections Attributes and Parameters of a docstring.

    A line is "names : type   meaning, low .. high [unit]"; type, range and unit may be missing, and
    what follows is indented.
    """
    text = inspect.cleandoc(docstring or "")
    found = {}
    for lines in re.findall(r"^(?:Attributes|Parameters)\n-+\n(.+?)(?:\n\n|\Z)", text, re.M | re.S):
        for entry in re.split(r"\n(?=\S)", lines):
            parts = re.match(r"(\w+(?:, \w+)*)(?: : \S.*?)?(?:\s{2,}(.+))?$", entry, re.S)
            if parts:
                meaning = _meaning(" ".join((parts[2] or "").split()))
                found |= dict.fromkeys(parts[1].split(", "), meaning)
    return found


def _meaning(text: str) -> Meaning:
    unit = re.search(r" ?\[([^,\]]+)\]$", text)
    text = text[: unit.start()] if unit else text
    stated = re.search(r"(?:^|, |; )(\S+?) ?\.\. ?(\S+(?: - 1)?)$", text)
    text = text[: stated.start()] if stated else text
    limits = (_number(stated[1]), _number(stated[2])) if stated else None
    return Meaning(text, unit[1] if unit else "", limits)


def _number(text: str) -> float:
    """A number; 2^63 - 1 as well."""
    power = re.fullmatch(r"2\^(\d+) - 1", text)
    return 2.0 ** int(power[1]) - 1.0 if power else float(text)
