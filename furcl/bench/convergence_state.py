"""What a convergence run has measured so far: written after every render, checked when read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import msgspec

from furcl.bench.convergence_plan import Plan
from furcl.bench.convergence_reference import rendered_spp
from furcl.errors import BenchError
from furcl.files import atomic_path, file_name
from furcl.values import shown


class Record(TypedDict):
    """One measured render; docs/convergence.md has the meanings."""

    key: str
    seed: int
    seconds: float
    cpu_seconds: float
    mse_against_reference: float
    mse: float
    rmse: float
    relmse: float
    flip: float
    variance: float | None
    mean: float
    rays: int
    paths: int
    path_length: float
    hits_per_path: float
    lobes: dict[str, int]
    nonfinite: int


class _Facts(TypedDict):
    spp: int
    mean: float
    mean_error: float


class _Scene(TypedDict):
    reference: _Facts


class _Stored(TypedDict):
    scenes: dict[str, _Scene]
    setup: dict[str, dict[str, Any]]
    renders: dict[str, Record]
    workers: NotRequired[list[str]]


def name_of(scene: str, variant: str) -> str:
    """The key of what belongs to a variant of a scene, whatever their names hold."""
    return f"{file_name(scene)}|{file_name(variant)}"


class State:
    """The file renders.json of a folder.

    Attributes
    ----------
    data : dict     scenes: facts by name; setup: by `name_of`; renders: by `key`; workers: the
                    addresses of those of a cluster that rendered

    Raises
    ------
    BenchError      a file that furcl did not write so
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data: dict[str, Any] = {"scenes": {}, "setup": {}, "renders": {}, "workers": []}
        if not path.exists():
            return
        try:
            self.data = json.loads(path.read_text(encoding="utf-8"))
            msgspec.convert(self.data, _Stored)
            self.data.setdefault("workers", [])
        except (OSError, ValueError, RecursionError) as error:
            raise BenchError(
                f"{path}: {shown(str(error))}; it was edited or damaged, remove it to start again"
            ) from None

    def save(self) -> None:
        """Write it, whole or not at all."""
        with atomic_path(self.path) as temporary:
            temporary.write_text(json.dumps(self.data), encoding="utf-8")

    def of_variant(self, scene: str, variant: str) -> Mapping[tuple[int, int], Record]:
        """The renders of a variant, by samples a pixel and run.

        Raises
        ------
        BenchError      a key that is none
        """
        prefix, found = name_of(scene, variant) + "|", {}
        for key, record in self.data["renders"].items():
            if key.startswith(prefix):
                try:
                    spp, run = map(int, key.removeprefix(prefix).split("|"))
                except ValueError:
                    raise BenchError(
                        f"{self.path}: {shown(key)}: expected {prefix}SPP|RUN; it was edited, "
                        f"remove it to start again"
                    ) from None
                found[spp, run] = record
        return found

    def add(
        self,
        scene: str,
        variant: str,
        spp: int,
        run: int,
        record: dict[str, Any],
        worker: str | None = None,
    ) -> None:
        """Keep a render, by a worker of a cluster or by this process."""
        if worker is not None and worker not in self.data["workers"]:
            self.data["workers"].append(worker)
        self.data["renders"][f"{name_of(scene, variant)}|{spp}|{run}"] = record
        self.save()

    def check(self, plan: Plan) -> None:
        """Refuse a plan that does not go on with what is there.

        Raises
        ------
        BenchError      renders with seeds, or against a reference, that are not the plan's
        """
        for scene in plan.scenes:
            renders = {
                (variant, *where): record
                for variant in plan.names
                for where, record in self.of_variant(scene.name, variant).items()
            }
            for where, record in renders.items():
                if record["seed"] != plan.seed_of(scene.name, *where):
                    raise BenchError(
                        f"{self.path}: holds renders of {scene.name} with another seed than "
                        f"{plan.seed}; continue with the --seed that it was begun with, or give "
                        f"another folder"
                    )
            if not renders or scene.name not in self.data["scenes"]:
                continue
            before = self.data["scenes"][scene.name]["reference"]["spp"]
            if before != rendered_spp(plan.reference_spp):
                raise BenchError(
                    f"{self.path}: holds renders of {scene.name} that were compared with a "
                    f"reference of {before} samples a pixel, not {plan.reference_spp}; continue "
                    f"with --reference-spp {before}, or give another folder"
                )
