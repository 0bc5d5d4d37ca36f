"""The light of a scene: its environment and its lamps, and how a light sample takes one of them.

The host twin, in float64, of kernels/include/light/lights.clh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from furcl.cdf import inclusive_cdf
from furcl.light.lamps import distant
from furcl.light.lamps.lamps import Lamps
from furcl.light.lamps.layout import HEADER, LEAST_CHANCE, LampsPart, offsets, size_of
from furcl.light.lamps.record import Array
from furcl.light.lamps.tree import Whole
from furcl.light.model import Light, LightPart
from furcl.light.sample import LightSamples


class ChosenLights(NamedTuple):
    """Light samples of a scene for n points.

    Attributes
    ----------
    samples : LightSamples      whose pdf holds the chance of the light
    rays_find_it : (n,) bool    so that it is weighed against them
    lamp : (n,)                 which a shadow ray does not stop at; -1: none
    """

    samples: LightSamples
    rays_find_it: NDArray[np.bool_]
    lamp: Whole


@dataclass(frozen=True, eq=False)
class Lights:
    """An environment, lamps or both.

    A light sample takes one of the lamps that have a place, found in their tree, or one of the
    lights at infinity: environment first, then lamps, by the luminance that comes from them.
    """

    environment: Light | None
    lamps: Lamps | None

    @property
    def environment_part(self) -> LightPart | None:
        """What kernels are built from for the environment."""
        return self.environment.part() if self.environment else None

    @property
    def lamps_part(self) -> LampsPart | None:
        """What kernels are built from for the lamps."""
        return self.lamps.part() if self.lamps else None

    @property
    def n_negative(self) -> int:
        """Values below zero that were read and set to zero."""
        return self.environment.n_negative if self.environment else 0

    @property
    def grey(self) -> bool:
        """Whether all radiance is the same in all channels."""
        environment = self.environment is None or self.environment.grey
        return environment and (self.lamps is None or self.lamps.grey)

    @property
    def hidden(self) -> tuple[str, ...]:
        """Kinds of light there are that rays never find, only light samples."""
        lost = self.environment is not None and not self.environment.at_infinity
        names = (self.environment.kind,) if lost and self.environment else ()
        return (*names, *(self.lamps.hidden if self.lamps else ()))

    @property
    def worth_sampling(self) -> bool:
        """Whether light samples reduce noise: not all directions bring the same."""
        return self.lamps is not None or bool(
            self.environment and (self.environment.worth_sampling or self.hidden)
        )

    def fluences(self, place: Array) -> Array:
        """Luminance of radiance over all directions of what is at infinity: the environment as it
        is at a place (3,), then lamps."""
        environment = [self.environment.fluence(place)] if self.environment else []
        return np.array([*environment, *(self.lamps.fluences() if self.lamps else [])])

    def near_chance(self, points: Array, place: Array) -> Array:
        """Chance (n,) that a sample at points (n, 3) is of a lamp that has a place."""
        if self.lamps is None or self.lamps.tree is None:
            return np.zeros(len(points))
        placed = self.lamps.tree.importance(np.zeros(len(points), np.int64), points)
        infinite = self.fluences(place).sum()
        if not infinite > 0.0:
            return np.where(placed > 0.0, 1.0, 0.0)
        share = np.clip(placed / (placed + infinite), LEAST_CHANCE, 1.0 - LEAST_CHANCE)
        return np.where(placed > 0.0, share, 0.0)

    def infinite_chances(self, place: Array) -> Array:
        """Chances of the lights at infinity among themselves."""
        return np.diff(_infinite_cdf(self.fluences(place)).astype(np.float64), prepend=0.0)

    def sample(self, points: Array, u: Array, choice: Array, place: Array) -> ChosenLights:
        """A light sample for each point (n, 3).

        Parameters
        ----------
        u : (n, 2)          numbers in [0, 1) for the direction
        choice : (n, 4)     for the choice of the light
        place : (3,)        where the environment's strength is taken: the middle of the groom
        """
        n, near = len(points), self.near_chance(points, place)
        placed = choice[:, 3] < near
        out = LightSamples(np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)), np.zeros(n))
        found, lamp = np.zeros(n, bool), np.full(n, -1)

        def put(rows, samples: LightSamples, chance) -> None:
            for whole, part in zip(out, samples, strict=True):
                whole[rows] = part
            out.pdf[rows] *= chance

        if self.lamps is not None and self.lamps.tree is not None:
            rows = np.flatnonzero(placed)
            numbers = choice[rows].copy()
            numbers[:, 3] /= np.maximum(near[rows], np.finfo(np.float64).tiny)
            which, chance = self.lamps.tree.choose(points[rows], numbers, self.lamps.by_position)
            put(rows, self.lamps.sample(which, points[rows], u[rows]), chance * near[rows])
            found[rows] = self.lamps.found_by_rays(which)
            lamp[rows] = np.where(chance > 0.0, which, -1)
        fluences = self.fluences(place)
        if fluences.size:
            cdf, first = _infinite_cdf(fluences), int(self.environment is not None)
            chances = self.infinite_chances(place)
            index = np.searchsorted(cdf, choice[:, 0], side="right")
            around = ~placed & (index < first)
            if self.environment is not None:
                samples = self.environment.sample(points[around], u[around])
                put(around, samples, chances[0] * (1.0 - near[around]))
                found[around] = self.environment.at_infinity
            if self.lamps is not None:
                far = ~placed & (index >= first)
                which = self.lamps.n_placed + index[far] - first
                share = chances[index[far]] * (1.0 - near[far])
                put(far, self.lamps.sample(which, points[far], u[far]), share)
                found[far] = self.lamps.found_by_rays(which)
        return ChosenLights(out, found, lamp)

    def radiance_of_rays(
        self, points: Array, directions: Array, pdf: Array, met: tuple[Array, Whole], place: Array
    ) -> Array:
        """Radiance (n, 3) that rays bring, weighed against light samples of their origins by the
        balance heuristic.

        Parameters
        ----------
        points, directions : (n, 3)     origins; unit
        pdf : (n,)                      density with which directions were sampled; 0: by a camera,
                                        which takes no light samples
        met : (n,), (n,)                distance and number of the lamp that ends a ray; -1: it
                                        leaves the scene
        place : (3,)                    as for `sample`
        """
        near = self.near_chance(points, place)

        def weighed(rows, radiance: Array, rival: Array) -> Array:
            share = pdf[rows] / np.where(pdf[rows] > 0.0, pdf[rows] + rival, 1.0)
            return radiance * np.where(pdf[rows] > 0.0, share, 1.0)[:, None]

        out = np.zeros((len(points), 3))
        distances, lamp = met
        escaped = np.flatnonzero(lamp < 0)
        chances = self.infinite_chances(place) if len(self.fluences(place)) else np.zeros(0)
        ways, far = directions[escaped], 1.0 - near[escaped]
        if self.environment is not None:
            rival = far * chances[0] * self.environment.pdf(points[escaped], ways)
            out[escaped] += weighed(escaped, self.environment.radiance(ways), rival)
        if self.lamps is None:
            return out
        first = int(self.environment is not None)
        for i in range(self.lamps.n_wide):
            one = self.lamps.records[self.lamps.n_placed + i :][:1]
            inside = distant.inside(one, ways)
            rows = escaped[inside]
            rival = far[inside] * chances[first + i] * distant.density(one)
            out[rows] += weighed(rows, np.broadcast_to(one["radiance"], (len(rows), 3)), rival)
        rows = np.flatnonzero(lamp >= 0)
        if len(rows) and self.lamps.tree is not None:
            lamp, origins = lamp[rows], points[rows]
            density = self.lamps.density(lamp, origins, directions[rows], distances[rows])
            chance = self.lamps.tree.chance(lamp, origins, self.lamps.by_position)
            radiance = self.lamps.records["radiance"][lamp] * (density > 0.0)[:, None]
            out[rows] = weighed(rows, radiance, near[rows] * chance * density)
        return out

    def device_buffer(self, light_sampling: bool, place: Array) -> NDArray[np.float32]:
        """The flat buffer for the kernels: the environment's own where there are no lamps, else
        `furcl.light.lamps.layout.HEADER`, lamps, chances at infinity, nodes and the
        environment's.

        Parameters
        ----------
        place : (3,)    as for `sample`
        """
        environment = np.zeros(0, np.float32)
        if self.environment is not None:
            environment = self.environment.device_buffer(light_sampling)
        if self.lamps is None:
            return environment
        fluences = self.fluences(place)
        lamps, nodes = self.lamps.lamp_words(), self.lamps.node_words()
        cdf = _infinite_cdf(fluences) if fluences.size else np.zeros(0, np.float32)
        cdf_at = size_of(HEADER) + lamps.size
        header = np.zeros(size_of(HEADER), np.uint32)
        words = {
            "ENVIRONMENT": cdf_at + cdf.size + nodes.size,
            "N_LAMPS": len(lamps),
            "N_PLACED": self.lamps.n_placed,
            "N_WIDE": self.lamps.n_wide,
            "NODES": cdf_at + cdf.size,
            "N_NODES": len(nodes),
            "INFINITE_CDF": cdf_at,
            "N_INFINITE": cdf.size,
            "FLUENCE": np.float32(fluences.sum()).view(np.uint32),
            "WORDS": cdf_at + cdf.size + nodes.size + environment.size,
        }
        for name, at in offsets(HEADER).items():
            header[at] = words[name]
        return np.concatenate(
            [header.view(np.float32), lamps.ravel(), cdf, nodes.ravel(), environment]
        )


def _infinite_cdf(fluences: Array) -> NDArray[np.float32]:
    """Running sums of the chances of lights at infinity; even ones where all are dark."""
    total = fluences.sum()
    chances = fluences / total if total > 0.0 else np.full(len(fluences), 1.0 / len(fluences))
    return inclusive_cdf(chances)
