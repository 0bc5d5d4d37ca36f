"""A path tracer in float64 numpy for a few pixels of small scenes: what the device must agree with.

It shares the scene's description and the medulla's profiles with the device and nothing else:
every ray is tried on every segment and lamp, the offset h is uniform, lobes are chosen by their
attenuation, light is met by chance, but of lamps without extent every hit is given all, and paths
end at the scene's depth only.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from furcl.fibre.double_cylinder import reference
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.angles import (
    centre_and_width,
    longitudinal,
    wrapped_gaussian,
)
from furcl.fibre.double_cylinder.reference.offsets import lobe_names
from furcl.fibre.double_cylinder.reference.profiles import MedullaData
from furcl.groom.curves import Curves
from furcl.scene.tables import Scene

Array = NDArray[np.float64]

_NEAR = 0.3
"""Width [rad] of the directions near the unscattered lobe."""

_CHUNK = 2_000_000
"""Pairs of a ray and a segment that are tried together."""


class HostRenderer:
    """Paths through pixels of a scene with a box filter, a pinhole and no body, in lamps and an
    environment that rays find by chance.

    Parameters
    ----------
    scene : Scene
    profiles : object               those that the device used; bcsdf.UNSCATTERED leaves out what
                                    the medulla scatters, None is for one that scatters nothing
    """

    def __init__(self, scene: Scene, profiles: MedullaData) -> None:
        self.scene = scene
        self.profiles = profiles
        self.curves = scene.build_curves().traced()
        self.fibre: Fibre = scene.build_fibre()
        self.lights = scene.build_lights()
        self._segments = Segments(self.curves)
        self._lobes = list(lobe_names(self.fibre, scene.render.residual))

    def pixel(self, x: int, y: int, paths: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Mean radiance (3,) of a pixel and the variance of that mean."""
        origin, direction = self._camera_rays(x, y, paths, rng)
        radiance, throughput = np.zeros((paths, 3)), np.ones((paths, 3))
        alive = np.arange(paths)
        left = np.full(paths, -1)
        for depth in range(self.scene.render.max_depth + 1):
            distance, segment, u = self._segments.closest(origin, direction, left)
            t, lamp = self._lamp_before(origin, direction, distance)
            out = (segment < 0) | (lamp >= 0)
            if out.any():
                light = self._light_of(origin[out], direction[out], t[out], lamp[out])
                radiance[alive[out]] += throughput[out] * light
            hit = np.flatnonzero(~out)
            if not len(hit) or depth == self.scene.render.max_depth:
                break
            given = self._light_given(segment[hit], u[hit], -direction[hit], rng)
            radiance[alive[hit]] += throughput[hit] * given
            alive, throughput = alive[hit], throughput[hit]
            left = segment[hit]
            origin, direction, weight = self._scatter(left, u[hit], -direction[hit], rng)
            throughput = throughput * weight
            on = np.flatnonzero(throughput.max(-1) > 0.0)
            alive, left, throughput = alive[on], left[on], throughput[on]
            origin, direction = origin[on], direction[on]
            if not len(alive):
                break
        return radiance.mean(0), radiance.var(0, ddof=1) / paths

    def _camera_rays(self, x: int, y: int, n: int, rng: np.random.Generator):
        camera = self.scene.resolved_camera(self.curves)
        film = self.scene.film
        px, py = x + rng.random(n), y + rng.random(n)
        return camera.rays(px / film.width, py / film.height, film.aspect)

    def _scatter(self, segment, u: Array, wo: Array, rng: np.random.Generator):
        """Next origin, direction and weight of paths that met a fibre."""
        n = len(segment)
        segments = self._segments
        frame, local = self._frames(segment, wo)
        tangent = frame[:, 0]
        theta = np.arctan2(local[:, 0], np.hypot(local[:, 1], local[:, 2]))
        h = rng.uniform(-1.0, 1.0, n)
        energy = reference.attenuation(
            self.fibre, h, theta, self.profiles, self.scene.render.residual
        )
        chance = np.stack([energy[name].mean(-1) for name in self._lobes])
        total = chance.sum(0)
        cdf = np.cumsum(chance, axis=0) / np.where(total > 0.0, total, 1.0)
        lobe = np.minimum((rng.random(n) >= cdf).sum(0), len(self._lobes) - 1)
        wi, weight = np.zeros((n, 3)), np.zeros((n, 3))
        for p, name in enumerate(self._lobes):
            mine = np.flatnonzero((lobe == p) & (total > 0.0))
            if len(mine):
                wi[mine], ratio = self._direction(p, name, local[mine], theta[mine], h[mine], rng)
                weight[mine] = ratio * (total[mine] / chance[p, mine])[:, None]
        direction = np.einsum("nij,ni->nj", frame, wi)
        norm = np.linalg.norm(direction, axis=1, keepdims=True)
        direction = np.divide(direction, norm, out=tangent.copy(), where=norm > 0.0)
        origin = segments.start[segment] + u[:, None] * segments.axis[segment]
        return origin, direction, weight

    def _frames(self, segment, wo: Array) -> tuple[Array, Array]:
        """Rows x, y, z of the fibres' frames (n, 3, 3), and wo in them (n, 3)."""
        tangent = self._segments.axis[segment]
        tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
        side = np.cross(tangent, wo)
        size = np.linalg.norm(side, axis=1, keepdims=True)
        side = np.divide(side, size, out=_perpendicular(tangent), where=size > 1e-12)
        frame = np.stack([tangent, np.cross(side, tangent), side], 1)
        return frame, np.einsum("nij,nj->ni", frame, wo)

    def _lamp_before(self, origin: Array, direction: Array, distance: Array):
        """Distance and number of the lamp that rays meet before a distance; inf and -1: none."""
        if self.lights.lamps is None:
            return np.full(len(origin), np.inf), np.full(len(origin), -1)
        t, lamp = self.lights.lamps.closest(origin, direction)
        return np.where(t < distance, t, np.inf), np.where(t < distance, lamp, -1)

    def _light_of(self, origin: Array, direction: Array, t: Array, lamp) -> Array:
        """Radiance (n, 3) of rays that end in light, in full: light samples take none of it."""
        all_of_it, anywhere = np.zeros(len(origin)), np.zeros(3)
        return self.lights.radiance_of_rays(origin, direction, all_of_it, (t, lamp), anywhere)

    def _light_given(self, segment, u: Array, wo: Array, rng: np.random.Generator) -> Array:
        """Radiance (n, 3) towards wo of lamps that rays cannot find, at a uniform h."""
        n, lamps, out = len(segment), self.lights.lamps, np.zeros((len(segment), 3))
        if lamps is None:
            return out
        origin = self._segments.start[segment] + u[:, None] * self._segments.axis[segment]
        frame, local = self._frames(segment, wo)
        for i in np.flatnonzero(~lamps.found_by_rays(np.arange(len(lamps.records)))):
            way = lamps.sample(np.full(n, i), origin, np.zeros((n, 2)))
            distance, blocker, _ = self._segments.closest(origin, way.directions, segment)
            free = (blocker < 0) | (distance >= way.distances)
            free &= self._lamp_before(origin, way.directions, way.distances)[1] < 0
            value = reference.evaluate(
                self.fibre,
                local,
                np.einsum("nij,nj->ni", frame, way.directions),
                rng.uniform(-1.0, 1.0, n),
                self.profiles,
                residual=self.scene.render.residual,
            )
            out += value * way.radiance * (free & (way.pdf > 0.0))[:, None]
        return out

    def _direction(self, p: int, name: str, wo: Array, theta: Array, h: Array, rng):
        """Directions (n, 3) of one lobe in the fibre's frame; value over density (n, 3)."""
        n = len(h)
        if name in reference.SCATTERED or (name == reference.RESIDUAL and self.fibre.is_simulated):
            return self._scattered_direction(p - 2, name, wo, theta, h, rng)
        p = 2 if name == reference.RESIDUAL else p
        geometry = reference.geometry(self.fibre, h, theta)
        beta = self.fibre.beta_n * math.sqrt(p + 1.0)
        phi = geometry.Phi(p) + beta * rng.standard_normal(n)
        if name == reference.RESIDUAL:
            phi = rng.uniform(-np.pi, np.pi, n)
        mu, width = centre_and_width(self.fibre, p, theta, phi)
        inclination = _around(mu, width, rng)
        energy = reference.attenuation(
            self.fibre, h, theta, self.profiles, name == reference.RESIDUAL
        )
        wi = _from_angles(inclination, phi + np.arctan2(wo[:, 2], wo[:, 1]))
        return wi, energy[name]

    def _scattered_direction(self, p: int, name: str, wo: Array, theta: Array, h: Array, rng):
        """Half of the directions from the whole sphere, half near those of the unscattered lobe."""
        n = len(h)
        centre = reference.geometry(self.fibre, h, theta).Phi(p)
        near = rng.random(n) < 0.5
        phi = np.where(near, centre + _NEAR * rng.standard_normal(n), rng.uniform(-np.pi, np.pi, n))
        around = _around(-theta, np.full(n, _NEAR), rng)
        inclination = np.where(near, around, np.arcsin(rng.uniform(-1.0, 1.0, n)))
        near_density = longitudinal(inclination, -theta, _NEAR**2) * wrapped_gaussian(
            phi - centre, _NEAR
        )
        wi = _from_angles(inclination, phi + np.arctan2(wo[:, 2], wo[:, 1]))
        value = reference.evaluate(self.fibre, wo, wi, h, self.profiles, lobe=name)
        return wi, value / (0.125 / np.pi + 0.5 * near_density)[:, None]


def _around(mu: Array, width: Array, rng: np.random.Generator) -> Array:
    """Inclinations with the longitudinal density: directions on the sphere with a density
    proportional to exp(cos(angle to mu) / width^2), whose azimuth is dropped."""
    v = np.broadcast_to(width, mu.shape) ** 2
    u = rng.random(len(mu))
    below = -v * np.log1p(-u * -np.expm1(-2.0 / v))  # 1 - cos of the angle
    turn = rng.uniform(0.0, 2.0 * np.pi, len(mu))
    sine = np.sqrt(np.maximum(below * (2.0 - below), 0.0))
    s = (1.0 - below) * np.sin(mu) + sine * np.cos(turn) * np.cos(mu)
    return np.arcsin(np.clip(s, -1.0, 1.0))


def _from_angles(theta: Array, phi: Array) -> Array:
    c = np.cos(theta)
    return np.stack([np.sin(theta), c * np.cos(phi), c * np.sin(phi)], 1)


def _perpendicular(tangent: Array) -> Array:
    other = np.where(np.abs(tangent[:, :1]) < 0.5, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    side = np.cross(tangent, other)
    return side / np.linalg.norm(side, axis=1, keepdims=True)


class Segments:
    """All segments of a groom, each tried with each ray."""

    def __init__(self, curves: Curves) -> None:
        first = curves.segment_vertices()
        points = curves.points.astype(np.float64)
        radii = curves.radii.astype(np.float64)
        self.start, self.axis = points[first], points[first + 1] - points[first]
        self.radius, self.widening = radii[first], radii[first + 1] - radii[first]
        self.strand = np.searchsorted(curves.offsets, first, side="right") - 1

    def left(self, origin: Array, direction: Array, segment):
        """First and last segment (m,) of the stretch that rays from `segment`, (m,), begin inside.

        Neighbours are inside together where the ray meets the ball around the vertex between them.
        """
        stretch = []
        for step in (-1, 1):
            end, going = segment.copy(), np.arange(len(segment))
            while len(going):
                beyond = end[going] + step
                inside = (beyond >= 0) & (beyond < len(self.start))
                going, beyond = going[inside], beyond[inside]
                between = np.maximum(end[going], beyond)
                w = self.start[between] - origin[going]
                t = np.maximum((w * direction[going]).sum(-1, keepdims=True), 0.0)
                met = np.linalg.norm(w - t * direction[going], axis=-1) <= self.radius[between]
                met &= self.strand[beyond] == self.strand[end[going]]
                going, beyond = going[met], beyond[met]
                end[going] = beyond
            stretch.append(end)
        return stretch

    def closest(self, origin: Array, direction: Array, left):
        """Distance, segment (-1: none) and place u on it of the nearest hit of every ray.

        A segment is hit where the ray comes nearest to it, if that is within the radius there.
        Rays from a fibre, from its segment `left` (-1: none), do not hit what they begin inside.
        """
        n = len(origin)
        distance, which, place = np.full(n, np.inf), np.full(n, -1), np.zeros(n)
        step = max(1, _CHUNK // len(self.start))
        number, on = np.arange(len(self.start)), np.flatnonzero(left >= 0)
        first, last = np.full(n, len(number)), np.full(n, -1)
        first[on], last[on] = self.left(origin[on], direction[on], left[on])
        for at in range(0, n, step):
            rays = slice(at, at + step)
            o, d = origin[rays, None, :], direction[rays, None, :]
            w = self.start - o
            foot = (w * d).sum(-1)
            along = self.axis @ direction[rays].T
            along = along.T
            gap = w - foot[..., None] * d
            across = self.axis - along[..., None] * d
            square = (across * across).sum(-1)
            u = np.divide(
                -(gap * across).sum(-1), square, out=np.zeros_like(square), where=square > 0.0
            )
            u = np.clip(u, 0.0, 1.0)
            gap = gap + u[..., None] * across
            t = foot + u * along
            radius = self.radius + u * self.widening
            hit = ((gap * gap).sum(-1) <= radius * radius) & (t > 0.0)
            hit &= (number < first[rays, None]) | (number > last[rays, None])
            t = np.where(hit, t, np.inf)
            best = t.argmin(1)
            rows = np.arange(len(best))
            found = np.isfinite(t[rows, best])
            distance[rays] = t[rows, best]
            which[rays] = np.where(found, best, -1)
            place[rays] = u[rows, best]
        return distance, which, place
