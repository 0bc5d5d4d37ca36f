"""Bytes that a stage moves for each of its paths, counted in the kernel's own text."""

from __future__ import annotations

import re

from furcl.bench.features import preprocessed
from furcl.device import layout
from furcl.device.features import Features
from furcl.render.wavefront import RAY_STAGES, STAGES

_ATTRIBUTE = re.compile(r"__attribute__\s*\(\((?:[^()]|\([^()]*\))*\)\)")
_NAME = re.compile(r"(\w+)\s*\(")
_WORD = re.compile(r"\w+")


def bytes_per_item(stage: str, features: Features) -> int:
    """Bytes of the path state, queues, film and segments that a stage touches for one of its items.

    Every plane that the kernel or a function that it calls names counts once, 4 bytes, whether it
    is read, written or both; a queue entry read and one written count 4 each. Early ends are not
    seen, so it is a bound from above. Tree, tables and environment depend on the ray and are not
    counted.
    """
    bodies = functions(preprocessed(STAGES[stage], features))
    words = _reachable(stage, bodies)
    planes = sum(f"PS_{plane}" in words for plane in layout.planes(features))
    queues = sum(name.endswith("queue") for name in words & _parameters(bodies[stage]))
    total = 4 * (planes + min(queues, 2))
    if "film" in words & _parameters(bodies[stage]):
        total += 4 * (features.channels * (4 if features.variance else 2) + 1)
    if stage not in RAY_STAGES and "vertices" in _parameters(bodies[stage]):
        total += 2 * (16 if features.point_radii else 12)
    return total


def functions(text: str) -> dict[str, str]:
    """The functions of preprocessed OpenCL C: name -> its head and body."""
    found, depth, start = {}, 0, 0
    for match in re.finditer(r"[{}]", text):
        depth += 1 if match[0] == "{" else -1
        if match[0] == "}" and depth == 0:
            whole = _ATTRIBUTE.sub("", text[start : match.end()])
            name = _NAME.search(whole.partition("{")[0])
            if name:
                found[name[1]] = whole
            start = match.end()
    return found


def _parameters(function: str) -> set[str]:
    return set(_WORD.findall(function.partition("{")[0]))


def _reachable(name: str, bodies: dict[str, str]) -> set[str]:
    """All words of a function and of those that it calls."""
    words: set[str] = set()
    waiting, seen = [name], {name}
    while waiting:
        found = set(_WORD.findall(bodies[waiting.pop()]))
        words |= found
        calls = (found & set(bodies)) - seen
        seen |= calls
        waiting += calls
    return words
