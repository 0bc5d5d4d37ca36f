"""All lamps of a scene: the host twin of kernels/include/light/lamps/."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from furcl.errors import LightError
from furcl.image.colour import luminance
from furcl.light.lamps import distant, planar, point, sphere
from furcl.light.lamps.layout import AREA_KINDS, KINDS, LAMP, MOST_LAMPS, NODE, LampsPart, size_of
from furcl.light.lamps.record import Array, Records, is_kind
from furcl.light.lamps.tree import Emitters, LampTree, Whole, build
from furcl.light.sample import LightSamples

FLAT_KINDS = ("quad", "disk", "triangle")
SMALL_KINDS = ("point", "spot")

# Every ray that leaves the scene is compared with all lamps at infinity that have an angle.
MOST_WIDE = 1024


@dataclass(frozen=True, eq=False)
class Lamps:
    """Lamps of any kinds.

    Attributes
    ----------
    records : (n,) Records      those that have a place, then those at infinity with an angle, then
                                those at infinity without
    tree : LampTree or None     over the first, if there are any
    by_position : bool          how one of these is chosen
    """

    records: Records
    tree: LampTree | None
    by_position: bool = True

    @classmethod
    def make(cls, parts: Sequence[Records], by_position: bool = True) -> Lamps:
        """The lamps of all parts.

        Raises
        ------
        LightError      more than MOST_LAMPS, or more than MOST_WIDE at infinity with an angle
        """
        lamps = np.concatenate(parts)
        far, wide = is_kind(lamps, "distant"), lamps["extent"] > 0.0
        if len(lamps) > MOST_LAMPS:
            raise LightError(
                f"{len(lamps)} lamps: at most {MOST_LAMPS} are allowed; use fewer and larger ones"
            )
        if (far & wide).sum() > MOST_WIDE:
            raise LightError(
                f"{(far & wide).sum()} distant lamps with an angle: at most {MOST_WIDE} are "
                f"allowed; put them into a picture of the surroundings, an [environment]"
            )
        ordered = np.concatenate([lamps[~far], lamps[far & wide], lamps[far & ~wide]])
        placed = ordered[: (~far).sum()]
        return cls(ordered, build(_emitters(placed)) if len(placed) else None, by_position)

    @property
    def n_placed(self) -> int:
        """Lamps that have a place."""
        return int((~is_kind(self.records, "distant")).sum())

    @property
    def n_wide(self) -> int:
        """Lamps at infinity that rays find."""
        far = self.records[self.n_placed :]
        return int((far["extent"] > 0.0).sum())

    @property
    def grey(self) -> bool:
        """Whether the light of all is the same in all channels."""
        return bool((self.records["radiance"] == self.records["radiance"][:, :1]).all())

    @property
    def hidden(self) -> tuple[str, ...]:
        """Kinds there are that only light samples find."""
        names = [kind for kind in SMALL_KINDS if is_kind(self.records, kind).any()]
        return (*names, *(["distant"] if self.n_placed + self.n_wide < len(self.records) else []))

    def part(self) -> LampsPart:
        """What kernels are built from."""
        there = np.unique(self.records["kind"])
        return LampsPart(tuple(KINDS[number] for number in there), self.by_position)

    def fluences(self) -> Array:
        """Luminance of radiance over all directions (n_infinite,), of lamps at infinity."""
        far = self.records[self.n_placed :]
        cone = 2.0 * np.pi * far["extent"]
        return np.asarray(luminance(far["radiance"]), np.float64) * np.where(cone > 0.0, cone, 1.0)

    def sample(self, which: Whole, points: Array, u: Array) -> LightSamples:
        """Samples of lamps (n,) as if each were the only one, from points (n, 3) by numbers (n, 2).

        Densities are per solid angle; of lamps without extent they are 1 and `radiance` is
        irradiance.
        """
        lamps = self.records[which]
        n = len(which)
        out = LightSamples(np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)), np.zeros(n))
        for kinds, sampled in (
            (FLAT_KINDS, planar.sample),
            (("sphere",), sphere.sample),
            (SMALL_KINDS, lambda lamps, points, u: point.sample(lamps, points)),
            (("distant",), lambda lamps, points, u: distant.sample(lamps, u)),
        ):
            mine = _any_kind(lamps, kinds)
            for whole, part in zip(out, sampled(lamps[mine], points[mine], u[mine]), strict=True):
                whole[mine] = part
        return out

    def density(self, which: Whole, points: Array, directions: Array, distances: Array) -> Array:
        """Density (n,) of `sample` of lamps that rays met; 0 where the lamp is dark."""
        lamps = self.records[which]
        flat = planar.density(lamps, directions, distances)
        return np.where(is_kind(lamps, "sphere"), sphere.density(lamps, points), flat)

    def found_by_rays(self, which: Whole) -> NDArray[np.bool_]:
        """Whether rays can find lamps (n,)."""
        lamps = self.records[which]
        wide = is_kind(lamps, "distant") & (lamps["extent"] > 0.0)
        return _any_kind(lamps, AREA_KINDS) | wide

    def closest(self, origins: Array, directions: Array) -> tuple[Array, Whole]:
        """Distance and number of the lamp that each ray meets first; inf and -1: none."""
        distance, lamp = np.full(len(origins), np.inf), np.full(len(origins), -1)
        for i in np.flatnonzero(_any_kind(self.records, AREA_KINDS)):
            one = np.repeat(self.records[i : i + 1], len(origins))
            hit = sphere.hit if is_kind(one[:1], "sphere")[0] else planar.hit
            t = hit(one, origins, directions)
            lamp[t < distance] = i
            distance = np.minimum(distance, t)
        return distance, lamp

    def lamp_words(self) -> NDArray[np.float32]:
        """The records as the kernels read them, (n, LAMP_SIZE)."""
        out = np.zeros((len(self.records), size_of(LAMP)), np.float32)
        at = 0
        for name, width in LAMP:
            words = out[:, at : at + width]
            if name == "KIND":
                words.view(np.uint32)[:, 0] = self.records["kind"]
            elif name == "TRAIL" and self.tree is not None:
                words.view(np.uint32)[: self.n_placed, 0] = self.tree.trail
            elif name not in ("TRAIL", "UNUSED"):
                words[:] = self.records[name.lower()].reshape(-1, width)
            at += width
        return out

    def node_words(self) -> NDArray[np.float32]:
        """The nodes of the tree as the kernels read them, (n_nodes, NODE_SIZE)."""
        tree = self.tree
        if tree is None:
            return np.zeros((0, size_of(NODE)), np.float32)
        out = np.zeros((len(tree.lamp), size_of(NODE)), np.float32)
        at = 0
        for name, width in NODE:
            words, values = out[:, at : at + width], getattr(tree, name.lower())
            if name in ("NEXT", "LAMP"):
                words.view(np.uint32)[:, 0] = values.astype(np.int64) & 0xFFFFFFFF
            else:
                words[:] = values.reshape(-1, width)
            at += width
        return out


def _any_kind(lamps: Records, kinds: Sequence[str]) -> NDArray[np.bool_]:
    return np.isin(lamps["kind"], [KINDS.index(kind) for kind in kinds])


def _emitters(lamps: Records) -> Emitters:
    """What the tree needs of lamps that have a place."""
    flat, ball = _any_kind(lamps, FLAT_KINDS), is_kind(lamps, "sphere")
    spot = is_kind(lamps, "spot")
    lower, upper = lamps["centre"].copy(), lamps["centre"].copy()
    lower[flat], upper[flat] = planar.bounds(lamps[flat])
    lower[ball], upper[ball] = sphere.bounds(lamps[ball])
    seen = np.where(flat, lamps["extent"], 1.0)
    seen = np.where(ball, np.pi * lamps["extent"] ** 2, seen)
    one_sided = flat & (lamps["two_sided"] == 0.0)
    spread = np.where(one_sided, 0.0, np.pi)
    inner, outer = np.arccos(lamps["cos_inner"]), np.arccos(lamps["cos_outer"])
    spread = np.where(spot, inner, spread)
    edge = np.where(spot, outer - inner, 0.5 * np.pi)
    return Emitters(
        lower,
        upper,
        np.asarray(luminance(lamps["radiance"]), np.float64) * seen,
        np.where(one_sided[:, None] | spot[:, None], lamps["axis"], [[0.0, 0.0, 1.0]]),
        spread,
        edge,
    )
