"""Samplers of a user's own, for workers that have no file of them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from furcl.errors import SamplerError
from furcl.fibre import samplers
from furcl.files import file_name, read_text

_INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"', re.MULTILINE)


@dataclass(frozen=True)
class OwnSampler:
    """A sampler with its texts.

    Attributes
    ----------
    sampler : Sampler
    texts : dict        of its header and of what that includes from beside it, by their paths from
                        the folder of the header
    """

    sampler: samplers.Sampler
    texts: Mapping[str, str]

    @staticmethod
    def of(name: str) -> OwnSampler:
        """The sampler of a name.

        Raises
        ------
        SamplerError    no sampler of that name, or a file that cannot be sent
        """
        sampler = samplers.find(name)
        texts: dict[str, str] = {}
        _add(sampler, sampler.header, texts)
        return OwnSampler(sampler, texts)

    def register(self, folder: Path) -> None:
        """Write the texts below a folder, and make the sampler known here."""
        below = folder / file_name(self.sampler.name)
        for name, text in self.texts.items():
            (below / name).parent.mkdir(parents=True, exist_ok=True)
            (below / name).write_text(text, encoding="utf-8")
        samplers.register(
            self.sampler.name,
            below / self.sampler.header.name,
            needs_tables=self.sampler.needs_tables,
            scattered_angles=self.sampler.scattered_angles,
        )


def own_samplers(names: Iterable[str]) -> tuple[OwnSampler, ...]:
    """Those of the names that are not furcl's; SamplerError as `OwnSampler.of`."""
    return tuple(OwnSampler.of(name) for name in sorted({*names} - {*samplers.BUILT_IN}))


def _add(sampler: samplers.Sampler, path: Path, texts: dict[str, str]) -> None:
    """A file and what it includes from beside it."""
    folder = Path(os.path.normpath(sampler.header.parent))
    path = Path(os.path.normpath(path))
    if not path.is_relative_to(folder):
        raise SamplerError(
            f"sampler {sampler.name!r}: {path} is not below {folder}: workers are sent the "
            f"sampler's own folder alone; move it there"
        )
    name = path.relative_to(folder).as_posix()
    if name in texts:
        return
    try:
        texts[name] = read_text(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8"
        raise SamplerError(
            f"sampler {sampler.name!r}: {path} cannot be read: {reason}; workers need it"
        ) from None
    for include in _INCLUDE.findall(texts[name]):
        if (path.parent / include).is_file():
            _add(sampler, path.parent / include, texts)
