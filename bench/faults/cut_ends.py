"""What cutting a curve costs by itself: the reference of "light leaks through a strand beside
itself" is the same curve in short strands, whose ends take light."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from faults.case import Case
from faults.geometry import MOST_LIGHT, RADIUS, Array, difference, even_light, strands_of
from furcl.groom.curves import Curves

APART, ARM = 2.05, 1.0  # radii between the arms; their length, of 100 radii
PIECES = (1, 2, 4, 8)  # of each arm; the bend is one more


def _short_arms(pieces: int) -> tuple[Curves, Curves]:
    """24 strands that return beside themselves; the same with arms cut into so many pieces."""
    half, pitch, along = 0.5 * APART * RADIUS, 2.0 * APART * RADIUS, np.linspace(0.0, ARM, 25)
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 17)
    whole: list[Array] = []
    cut: list[Array] = []
    for x, y in ((pitch * i, 0.5 * pitch * row) for row in range(4) for i in range(6)):
        up, down = (
            np.stack([np.full(25, x + side), np.full(25, y), along], axis=1)
            for side in (-half, half)
        )
        bend = [x + half * np.sin(angle), np.full(17, y), ARM + half * np.cos(angle)]
        arms = [up, np.stack(bend, axis=1), down[::-1]]
        whole.append(np.concatenate(arms))
        cut.append(arms[1])
        n = 24 // pieces
        cut += [arm[n * i : n * i + n + 1] for arm in arms[::2] for i in range(pieces)]
    return strands_of(whole), strands_of(cut)


def _without_ends(folder: Path, quick: bool) -> str:
    """The light of a curve over that of its pieces is a line over the number of cuts, which ends
    within the bar where there are none. Errors are added as if all went one way."""
    if quick:
        return "at full size only"
    cuts = 2.0 * np.array(PIECES)
    found = [difference(even_light(48, 512), *_short_arms(pieces)) for pieces in PIECES]
    more, errors = np.array(found).T
    slope = (cuts - cuts.mean()) / np.sum((cuts - cuts.mean()) ** 2)
    at_none = 1.0 / len(cuts) - cuts.mean() * slope
    each, error_of_each = slope @ more, np.abs(slope) @ errors
    none, error = at_none @ more, np.abs(at_none) @ errors
    assert each > 3.0 * error_of_each, f"{each:+.3%} a cut: not the cuts"
    assert abs(none) + error <= MOST_LIGHT, f"{none:+.3%} +- {error:.3%} without cuts"
    return (
        f"{more[0]:+.3%} of light with {cuts[0]:.0f} cuts a strand to {more[-1]:+.3%} with "
        f"{cuts[-1]:.0f}, {each:+.3%} a cut, {none:+.3%} without"
    )


CASES = [Case("ends of cut strands take the light that short arms seem to leak", _without_ends)]
