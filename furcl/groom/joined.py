"""The grooms of a scene as one set of strands, in the order of their materials."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from furcl.errors import GroomError
from furcl.groom.copies import copied_strands
from furcl.groom.curves import MAX_POINTS, POINTS_AT_ONCE, Curves, adopted
from furcl.groom.motion import MOST_STEPS, Span, during, points_at

Transformed = Callable[[NDArray[np.float32]], NDArray]
"""Points (n, 3) -> points (n, 3) elsewhere."""


@dataclass(frozen=True, eq=False)
class Groom:
    """One groom of a scene.

    Attributes
    ----------
    name : str
    curves : Curves         where the scene has it
    material : int          number of its fibre material
    """

    name: str
    curves: Curves
    material: int = 0


class Grooms:
    """The grooms of a scene.

    Parameters
    ----------
    grooms : sequence of Groom      at least one

    Attributes
    ----------
    grooms : tuple of Groom         in the order of their materials, else as given

    Raises
    ------
    GroomError      more points than can be indexed
    """

    def __init__(self, grooms: Sequence[Groom]) -> None:
        self.grooms = tuple(sorted(grooms, key=lambda groom: groom.material))
        n = sum(groom.curves.n_points for groom in grooms)
        if n > MAX_POINTS:
            raise GroomError(
                f"grooms {', '.join(groom.name for groom in grooms)}: {n} points together; at most "
                f"{MAX_POINTS} can be indexed. Leave some out."
            )

    @classmethod
    def of(cls, curves: Curves | Grooms) -> Grooms:
        """These grooms, or the groom of a scene that has one."""
        return curves if isinstance(curves, Grooms) else cls([Groom("groom", curves)])

    @cached_property
    def curves(self) -> Curves:
        """The strands of all grooms, without their attributes; of a single groom its own.

        Where some move, all have the time steps of them all.
        """
        if len(self.grooms) == 1:
            return self.grooms[0].curves
        curves = [groom.curves for groom in self.grooms]
        dropped: dict[str, int] = {}
        for name, count in ((k, n) for c in curves for k, n in c.dropped.items()):
            dropped[name] = dropped.get(name, 0) + count
        begins = self.first_points
        offsets = [c.offsets[1:] + begin for c, begin in zip(curves, begins, strict=True)]
        times = self.times
        steps = [np.concatenate([points_at(c, time) for c in curves]) for time in times]
        return Curves.from_checked(
            np.stack(steps) if steps else np.concatenate([c.points for c in curves]),
            np.concatenate([c.radii for c in curves]),
            np.concatenate([[0], *offsets]).astype(np.int64),
            dropped,
            times,
        )

    @property
    def times(self) -> tuple[float, ...]:
        """Those of the time steps of all grooms that move, increasing."""
        return tuple(sorted({time for groom in self.grooms for time in groom.curves.times}))

    def during(self, span: Span) -> Grooms:
        """The grooms for as long as a shutter is open, see `furcl.groom.motion.during`.

        Raises
        ------
        GroomError      a span beyond a groom's times, or more than MOST_STEPS steps in it
        """
        found = Grooms(
            [replace(g, curves=during(g.curves, span, f"groom {g.name}")) for g in self.grooms]
        )
        if len(found.times) > MOST_STEPS:
            raise GroomError(
                f"groom {found.grooms[0].name}: {len(found.times)} time steps from {span[0]:g} to "
                f"{span[1]:g}, at most {MOST_STEPS} are kept; open camera.shutter for a shorter "
                f"time, or write fewer steps."
            )
        return found

    @property
    def first_points(self) -> list[int]:
        """The first point of each groom in `curves`."""
        return _starts([groom.curves.n_points for groom in self.grooms])

    @property
    def first_strands(self) -> list[int]:
        """The first strand of each groom in `curves`."""
        return _starts([groom.curves.n_strands for groom in self.grooms])

    def of_material(self, material: int) -> list[Groom]:
        """The grooms of a material; they follow each other in `curves`."""
        return [groom for groom in self.grooms if groom.material == material]

    def material_starts(self, n_materials: int) -> list[int]:
        """The first point of the strands of each material in `curves`; of a material without
        strands that of the next one."""
        sizes = [
            sum(groom.curves.n_points for groom in self.of_material(m)) for m in range(n_materials)
        ]
        return _starts(sizes)

    def traced(self) -> Grooms:
        """The grooms as rays meet them (`Curves.traced`): strands that are copies of a strand of
        another groom are left out too, in the later one."""
        traced = Grooms([replace(g, curves=g.curves.traced()) for g in self.grooms])
        if len(self.grooms) == 1:
            return traced
        curves = traced.curves
        copies = copied_strands(curves.points, curves.radii, curves.offsets, curves.steps)
        if not len(copies):
            return traced
        kept = np.ones(curves.n_strands, bool)
        kept[copies] = False
        left = []
        for groom, first in zip(traced.grooms, traced.first_strands, strict=True):
            own = kept[first : first + groom.curves.n_strands]
            if own.all():
                left.append(groom)
            elif own.any():
                left.append(replace(groom, curves=groom.curves.with_strands(own, "copied_strands")))
        return Grooms(left)


def placed(
    curves: Curves,
    transforms: Sequence[Transformed],
    scale: float,
    source: str,
    times: Sequence[float] = (0.0,),
) -> Curves:
    """A groom elsewhere.

    Parameters
    ----------
    transforms : callables  points (n, 3) -> points (n, 3): one, or one for each of the times
    scale : float           factor on radii
    source : str            the groom's name in messages
    times : floats          increasing; of several the groom gets time steps

    Raises
    ------
    GroomError              points or radii that are too large there
    """
    steps = np.empty((len(times), curves.n_points, 3), np.float32)
    for step, time, transform in zip(steps, times, transforms, strict=True):
        points = points_at(curves, time)
        for begin in range(0, curves.n_points, POINTS_AT_ONCE):
            part = slice(begin, begin + POINTS_AT_ONCE)
            step[part] = transform(points[part])
    moves = len(times) > 1
    return adopted(
        steps if moves else steps[0],
        curves.radii * np.float32(scale),
        curves.offsets,
        source=source,
        dropped=curves.dropped,
        attributes=curves.attributes,
        ignored=curves.ignored,
        units=curves.units,
        times=times if moves else None,
    )


def _starts(sizes: Sequence[int]) -> list[int]:
    """Running sums before each of some sizes."""
    return [0, *np.cumsum(sizes)[:-1].tolist()]
