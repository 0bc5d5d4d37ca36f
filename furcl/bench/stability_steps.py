"""The steps of a stability sweep, which do not depend on each other: one fibre, some integrals of a
model's own, one stiff scene."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from furcl.bench.stability_compare import Comparison
from furcl.bench.stability_integrals import factors, integrals
from furcl.bench.stability_look import POINTS_PER_FIBRE as LOOKED_AT_PER_FIBRE
from furcl.bench.stability_look import Look
from furcl.bench.stability_medulla import medulla_rows
from furcl.bench.stability_points import Points
from furcl.bench.stability_reference import reference_rows
from furcl.bench.stability_renders import render_row, scenes
from furcl.bench.stability_row import Row
from furcl.bench.stability_subject import Subject
from furcl.bench.stability_weights import Region
from furcl.device.choice import Device

POINTS_PER_FIBRE = 2000

WIDTHS = (1e-3, 1.5e-3, 3e-3, 1e-2, 0.03, 0.1, 0.27, 0.39, 0.41, 0.7, 1.0, 1.1, 1.49, 1.51, 2.5)
"""Widths [rad] at which M and D are integrated: the range that a `Fibre` allows, and both sides of
where a formula changes."""

GRID, COMPARED, LOOKED_AT, OWN, RENDERS = (
    "grid", "random points", "points looked at", "integrals", "renders",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Sweep:
    """What is swept.

    Attributes
    ----------
    subject : Subject
    quick : bool
    fibres : dict           GRID, COMPARED, LOOKED_AT -> number of fibres
    renders : bool          whether stiff scenes are rendered
    """

    subject: Subject
    quick: bool
    fibres: dict[str, int]
    renders: bool

    @staticmethod
    def of(
        subject: Subject, quick: bool, n_compared: int, n_looked_at: int, renders: bool
    ) -> Sweep:
        """The sweep of so many random points."""
        fibres = {
            GRID: len(_grid(subject, quick)),
            COMPARED: max(1, n_compared // POINTS_PER_FIBRE),
            LOOKED_AT: -(-n_looked_at // LOOKED_AT_PER_FIBRE),
        }
        return Sweep(subject, quick, fibres, renders)

    @property
    def n_compared(self) -> int:
        """Random points that are compared with float64."""
        return self.fibres[COMPARED] * POINTS_PER_FIBRE

    @property
    def n_looked_at(self) -> int:
        """Random points at which the device alone is looked at."""
        return self.fibres[LOOKED_AT] * LOOKED_AT_PER_FIBRE

    def steps(self, seed: int) -> Iterator[Step]:
        """All steps. Those of fibres share one generator of random numbers: each is to be drawn
        before the next is asked for."""
        rng, index = np.random.default_rng(seed), 0
        grid = _grid(self.subject, self.quick)
        own = len(OWN_ROWS.get(self.subject.model.name, ()))
        renders = len(scenes(self.quick)) if self.renders else 0
        for part, n in {**self.fibres, OWN: own, RENDERS: renders}.items():
            for number in range(n):
                edge = grid[number][:2] if part == GRID else None
                yield Step(index, part, number, n, rng if part in self.fibres else None, edge)
                index += 1

    def steps_apart(self, seed: int) -> list[Step]:
        """The same steps, each with a generator of its own in the state that it would be drawn
        from."""
        found = []
        for step in self.steps(seed):
            found.append(replace(step, rng=copy.deepcopy(step.rng)))
            if step.rng is not None:
                step.draw(self)
        return found


@dataclass(frozen=True, eq=False)
class Step:
    """One step of a sweep.

    Attributes
    ----------
    index : int         in the sweep
    part : str          of the sweep: GRID, ...
    number, n : int     in the part, and how many the part has
    rng : Generator or None     that a fibre and its points are drawn from
    edge : tuple or None        of a fibre of the grid: the parameter at an edge, and its value
    """

    index: int
    part: str
    number: int
    n: int
    rng: np.random.Generator | None
    edge: tuple[str, Any] | None = None

    def draw(self, sweep: Sweep) -> tuple[Any, Points]:
        """The fibre and its points."""
        assert self.rng is not None
        if self.part == GRID:
            fibre = _grid(sweep.subject, sweep.quick)[self.number][2]
            n = 200 if sweep.quick else POINTS_PER_FIBRE
        else:
            fibre = sweep.subject.random(self.rng)
            n = POINTS_PER_FIBRE if self.part == COMPARED else LOOKED_AT_PER_FIBRE
        return fibre, sweep.subject.points(fibre, self.rng, n)


@dataclass(frozen=True, eq=False)
class Found:
    """What a step found.

    Attributes
    ----------
    rows : list of Row
    regions : list of Region    largest weights, of fibres that are compared
    render : dict or None       of a stiff scene
    """

    rows: list[Row] = field(default_factory=list)
    regions: list[Region] = field(default_factory=list)
    render: dict[str, Any] | None = None


def take(device: Device, sweep: Sweep, step: Step) -> Found:
    """Do a step."""
    if step.part == RENDERS:
        spp, paths = (64, 600) if sweep.quick else (512, 4000)
        return Found(render=render_row(scenes(sweep.quick)[step.number], device, spp, paths))
    if step.part == OWN:
        own = OWN_ROWS[sweep.subject.model.name][step.number]
        return Found(own(device, sweep.quick))
    fibre, points = step.draw(sweep)
    if step.part == LOOKED_AT:
        look = Look(device, sweep.subject)
        look.add(fibre, points, step.number)
        return Found(list(look.rows.values()))
    # Compiling for every other fibre anew would take most of a quick run.
    specialised = step.part == COMPARED and step.number % 8 == 0 if sweep.quick else True
    comparison = Comparison(device, sweep.subject)
    comparison.add(fibre, points, step.number, specialised)
    return Found(list(comparison.rows.values()), comparison.regions)


def in_order(found: Iterable[tuple[Step, Found]]) -> Iterator[tuple[Step, Found]]:
    """Steps in their order, as soon as all before them are there."""
    waiting: dict[int, tuple[Step, Found]] = {}
    n_given = 0
    for step, one in found:
        waiting[step.index] = step, one
        while n_given in waiting:
            yield waiting.pop(n_given)
            n_given += 1


def _grid(subject: Subject, quick: bool) -> list[tuple[str, Any, Any]]:
    """Fibres of the grid; quick every third: all edges are also among the random ones."""
    fibres = list(subject.grid())
    return fibres[::3] if quick else fibres


def _factors(device: Device, quick: bool) -> list[Row]:
    return factors(device, WIDTHS, [math.radians(d) for d in (0.0, 30.0, 60.0, 85.0, 89.5, 90.0)])


def _integrals(device: Device, quick: bool) -> list[Row]:
    betas = (1e-3, 0.41, 2.5) if quick else (1e-3, 3e-3, 0.03, 0.39, 0.41, 1.49, 1.51, 2.5)
    degrees = (0.0, 60.0) if quick else (0.0, 60.0, 85.0, 89.5)
    return integrals(device, betas, [math.radians(d) for d in degrees])


def _reference(device: Device, quick: bool) -> list[Row]:
    return reference_rows()


OWN_ROWS: dict[str, tuple[Callable[[Device, bool], list[Row]], ...]] = {
    "double-cylinder": (_factors, _integrals, medulla_rows, _reference)
}
"""What else is swept of a model: integrals of its lobes, its simulated profiles, and its reference
against 60 digits."""
