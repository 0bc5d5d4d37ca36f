"""The text of a kernel: its file with all includes, and the declarations that it needs."""

from __future__ import annotations

import re
import threading
import time
from collections import OrderedDict
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from furcl.device import layout
from furcl.device.features import Features
from furcl.errors import KernelBuildError
from furcl.files import read_text
from furcl.paths import kernel_folder

_INCLUDE = re.compile(r'^\s*#\s*include\s+(?:"([^"]+)"|<(\w+)>)\s*$')
_CONDITION = re.compile(r"^\s*#\s*(if|ifdef|ifndef|endif)\b")
_GUARD = re.compile(r"^#ifndef (\w+)\n#define \1$", re.MULTILINE)

#: Modification time [ns] and size of a file; None where there is none.
Stamp = tuple[int, int] | None

#: Texts are kept that were used last, and files that have been as they are for so long [ns]: one
#: that is written twice within a tick of the clock of its folder keeps its stamp.
KEPT_TEXTS = 64
CALM_NS = 1_000_000_000


@dataclass(frozen=True)
class _Text:
    """A kernel's text, and the stamps of all places where its files were sought."""

    text: str
    stamps: dict[Path, Stamp]

    @property
    def holds(self) -> bool:
        """Whether all of them are as they were."""
        return all(_stamp(path) == stamp for path, stamp in self.stamps.items())


_texts: OrderedDict[Hashable, _Text] = OrderedDict()
_lock = threading.Lock()


def _stamp(path: Path) -> Stamp:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def expand(
    names: str | Sequence[str],
    features: Features,
    folder: Path | None = None,
    stamps: dict[Path, Stamp] | None = None,
) -> str:
    """The text of kernel files, one after the other, with every #include replaced by what it names.

    `#include "a/b.clh"` is sought beside the file that asks for it, then in the folder of the
    kernels and in its include folder; `#include <light>` is the header of that part of `features`,
    and an error where they have none.
    Caches of OpenCL runtimes hash the text that they are given, not the files that it includes;
    given the whole text they cannot return a stale kernel. Each file is included once, and again
    where it was included under a condition before, which may not hold: its guard does the rest.
    `stamps` takes those of all places where files are sought.

    Raises
    ------
    KernelBuildError    if an include is not found, naming the file and line that asks for it
    """
    folder = folder or kernel_folder()
    bases = (folder, folder / "include")
    seen: set[Path] = set()

    def look_at(path: Path) -> Path:
        if stamps is not None and path not in stamps:
            stamps[path] = _stamp(path)
        return path

    def find(include: str, beside: Path | None) -> Path | None:
        places = (*([beside] if beside else []), *bases)
        return next((p / include for p in places if look_at(p / include).is_file()), None)

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
                target = look_at(folder / "include" / features.parts[match[2]].header)
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
    folder = kernel_folder()
    asked = names if isinstance(names, str) else tuple(names)
    key = (folder, asked, features, tuple((extra or {}).items()))
    with _lock:
        kept = _texts.get(key)
        if kept:
            _texts.move_to_end(key)
    if kept and kept.holds:
        return kept.text
    stamps: dict[Path, Stamp] = {}
    begun = time.time_ns()
    text = expand(names, features, folder, stamps)
    text = layout.declarations(text, features, extra) + text
    if all(stamp is None or stamp[0] < begun - CALM_NS for stamp in stamps.values()):
        with _lock:
            _texts[key] = _Text(text, stamps)
            while len(_texts) > KEPT_TEXTS:
                _texts.popitem(last=False)
    return text
