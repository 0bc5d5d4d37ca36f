"""The text of a kernel: its file with all includes, and the declarations that it needs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from furcl.device import layout
from furcl.device.features import Features
from furcl.errors import KernelBuildError
from furcl.files import read_text
from furcl.paths import kernel_folder

_INCLUDE = re.compile(r'^\s*#\s*include\s+(?:"([^"]+)"|<(\w+)>)\s*$')
_CONDITION = re.compile(r"^\s*#\s*(if|ifdef|ifndef|endif)\b")
_GUARD = re.compile(r"^#ifndef (\w+)\n#define \1$", re.MULTILINE)


def expand(names: str | Sequence[str], features: Features, folder: Path | None = None) -> str:
    """The text of kernel files, one after the other, with every #include replaced by what it names.

    `#include "a/b.clh"` is sought beside the file that asks for it, then in the folder of the
    kernels and in its include folder; `#include <light>` is the header of that part of `features`,
    and an error where they have none.
    Caches of OpenCL runtimes hash the text that they are given, not the files that it includes;
    given the whole text they cannot return a stale kernel. Each file is included once, and again
    where it was included under a condition before, which may not hold: its guard does the rest.

    Raises
    ------
    KernelBuildError    if an include is not found, naming the file and line that asks for it
    """
    folder = folder or kernel_folder()
    bases = (folder, folder / "include")
    seen: set[Path] = set()

    def find(include: str, beside: Path | None) -> Path | None:
        places = (*([beside] if beside else []), *bases)
        return next((p / include for p in places if (p / include).is_file()), None)

    def walk(path: Path, asked_by: str, seen: set[Path]) -> list[str]:
        if path.resolve() in seen:
            return []
        seen.add(path.resolve())
        try:
            text = read_text(path)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is not UTF-8"
            raise KernelBuildError(
                f"{asked_by}: {path} cannot be read: {reason}; is it still there?"
            ) from None
        label = _label(path, bases)
        lines = [f'#line 1 "{label}"']
        depth = -1 if _GUARD.search(text) else 0
        for number, line in enumerate(text.splitlines(), 1):
            match = _INCLUDE.match(line)
            if not match:
                if condition := _CONDITION.match(line):
                    depth += -1 if condition[1] == "endif" else 1
                lines.append(line)
                continue
            place = f"{label}:{number}"
            if match[2] and match[2] not in features.parts:
                # An error only where the preprocessor gets there.
                lines.append(f"#error this build has no <{match[2]}>: give its Features one")
                continue
            if match[2]:
                target = folder / "include" / features.parts[match[2]].header
            else:
                target = find(match[1], path.parent)
            if target is None:
                raise KernelBuildError(
                    f"{place}: #include {match[1]!r} is not found beside it, in {folder} or in its "
                    f"include folder; check the spelling"
                )
            lines += walk(target, place, set(seen) if depth > 0 else seen)
            lines.append(f'#line {number + 1} "{label}"')
        return lines

    lines = []
    for name in [names] if isinstance(names, str) else names:
        start = find(name, None)
        if start is None:
            raise KernelBuildError(f"{name} is not found in {folder}; check the spelling")
        lines += walk(start, name, seen)
    return "\n".join(lines) + "\n"


def _label(path: Path, bases: tuple[Path, ...]) -> str:
    """What messages call a file: its place among the kernels, or its name."""
    for base in reversed(bases):
        if path.is_relative_to(base):
            return path.relative_to(base).as_posix()
    return path.name


def kernel_text(
    names: str | Sequence[str], features: Features, extra: Mapping[str, int] | None = None
) -> str:
    """Declarations followed by the expanded text: all that decides what a kernel does."""
    text = expand(names, features)
    return layout.declarations(text, features, extra) + text
