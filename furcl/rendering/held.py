"""Numbers of a path that all samples of a pixel share, so that what is left of a pixel's variance
is that of the others.

A path has numbers for the camera, and at every bounce for the offset h, the lobe, its direction,
the light sample and Russian roulette. With X the numbers that are held, the variance of a pixel's
samples has the mean E[Var(f | X)]; without any it is Var(f), and the difference is Var(E[f | X]),
what X alone decides (Sobol 1993, "Sensitivity estimates for nonlinear mathematical models").
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, get_args

from furcl.device.layout import HELD_AFTER, HELD_AT, HELD_BEFORE, HELD_BOUNCE, HELD_KINDS

Kind = Literal["h", "lobe", "direction", "light", "roulette"]
"""What the numbers of a bounce decide, in an order in which they can be fixed one by one."""
KINDS: tuple[Kind, ...] = get_args(Kind)
MAX_BOUNCE = (1 << 32 - HELD_BOUNCE) - 1


@dataclass(frozen=True)
class Held:
    """Numbers that all samples of a pixel share.

    Attributes
    ----------
    camera : bool       where in the pixel, and in the lens, a path begins
    bounce : int        0 to 65535; 0 is the first
    before, at, after : collections of Kind     numbers of the bounces before that one, of it, and
                        of those after it

    Raises
    ------
    ValueError          another kind, or another number of a bounce
    """

    camera: bool = False
    bounce: int = 0
    before: Collection[Kind] = ()
    at: Collection[Kind] = ()
    after: Collection[Kind] = ()

    def __post_init__(self) -> None:
        unknown = {*self.before, *self.at, *self.after} - set(KINDS)
        if unknown:
            raise ValueError(f"kind {min(unknown)!r}: allowed are {', '.join(KINDS)}")
        if not 0 <= self.bounce <= MAX_BOUNCE:
            raise ValueError(f"bounce {self.bounce}: allowed are 0 to {MAX_BOUNCE}")

    @property
    def word(self) -> int:
        """As the kernels read it (kernels/include/core/path_numbers.clh)."""
        parts = {HELD_BEFORE: self.before, HELD_AT: self.at, HELD_AFTER: self.after}
        word = self.bounce << HELD_BOUNCE | int(self.camera)
        for shift, kinds in parts.items():
            word |= sum(HELD_KINDS[kind] for kind in set(kinds)) << shift
        return word


def all_but(kind: Kind | None) -> Held:
    """Everything held but one kind at all bounces, or but the camera's numbers (None)."""
    kinds: list[Kind] = [k for k in KINDS if k != kind]
    return Held(camera=kind is not None, at=kinds, after=kinds)
