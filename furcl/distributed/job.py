"""All that a worker needs of a scene, which has none of its files."""

from __future__ import annotations

import copy
import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from furcl.distributed.own_samplers import OwnSampler, own_samplers
from furcl.groom.joined import Grooms
from furcl.scene.read import decode_scene
from furcl.scene.schema import files_in
from furcl.scene.tables import Scene


@dataclass(frozen=True, eq=False)
class Job:
    """A scene with its grooms and files, and with samplers of the user's own.

    Attributes
    ----------
    key : str           tells scenes apart
    document : dict     the scene; files by their digests
    files : dict        digest -> (suffix, bytes)
    grooms : Grooms
    samplers : tuple    OwnSampler each
    """

    key: str
    document: dict[str, Any]
    files: Mapping[str, tuple[str, bytes]]
    grooms: Grooms
    samplers: tuple[OwnSampler, ...] = ()

    @staticmethod
    def of(scene: Scene, grooms: Grooms, sampling: Iterable[str] = ()) -> Job:
        """The job of a scene.

        Parameters
        ----------
        sampling : names    of samplers that are needed beside that of the scene

        Raises
        ------
        SamplerError        a sampler whose files cannot be sent
        """
        document = msgspec.to_builtins(scene)
        files = {}
        for keys, table in files_in(document):
            path = Path(table[keys[-1]])
            if keys[0] == "curves" or "curves" in keys[2:]:
                continue  # grooms are sent as they are met by rays
            raw = path.read_bytes()
            table[keys[-1]] = hashlib.sha256(raw).hexdigest()
            files[table[keys[-1]]] = (path.suffix, raw)
        samplers = own_samplers([scene.render.sampling, *sampling])
        return Job(os.urandom(16).hex(), document, files, grooms, samplers)

    def scene(self, folder: Path) -> Scene:
        """The scene, its files written to a folder, and its samplers registered."""
        document = copy.deepcopy(self.document)
        for sampler in self.samplers:
            sampler.register(folder)
        for digest, (suffix, raw) in self.files.items():
            (folder / f"{digest}{suffix}").write_bytes(raw)
        for keys, table in files_in(document):
            if table[keys[-1]] in self.files:
                suffix = self.files[table[keys[-1]]][0]
                table[keys[-1]] = str(folder / f"{table[keys[-1]]}{suffix}")
        return decode_scene(document)
