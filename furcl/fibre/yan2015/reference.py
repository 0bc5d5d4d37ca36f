"""Float64 reference of the fibre of Yan et al. 2015, written from its equations.

f(wo, wi | h) = sum over lobes of A(h) D(phi | h) m(s), as for the double cylinder
(furcl.fibre.double_cylinder.reference has the conventions). Paths inside are named by what they
meet: T and R at the cuticle, t and r at the medulla. docs/models/yan2015.md has the equations; the
profiles of the medulla are asked for by the angles in it. Nothing here is shared with the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.fibre.cylinder.reference import Reference, Shape
from furcl.fibre.double_cylinder.reference import scattered
from furcl.fibre.double_cylinder.reference.angles import (
    centre_and_width,
    longitudinal,
    wrapped_gaussian,
)
from furcl.fibre.double_cylinder.reference.energy import medulla_edge
from furcl.fibre.double_cylinder.reference.optics import checked, cuticle, geometry
from furcl.fibre.double_cylinder.reference.profiles import MedullaData, profiles_in_use
from furcl.fibre.yan2015.parameters import Yan2015Fibre

Array = NDArray[np.float64]

# Reflections inside at the cuticle, reflections at the medulla and passages through it.
PATHS = {
    "TT": (0, 0, 0),
    "TRT": (1, 0, 0),
    "TrT": (0, 1, 0),
    "TtT": (0, 0, 1),
    "TrRrT": (1, 2, 0),
    "TrRtT": (1, 1, 1),
    "TtRtT": (1, 0, 2),
    # Before the passage that scatters.
    "TtTs": (0, 0, 0),
    "TrRtTs": (1, 1, 0),
    "TtRtTs": (1, 0, 1),
}
SCATTERED = ("TtTs", "TrRtTs", "TtRtTs")
RESIDUAL = "residual"


@dataclass(frozen=True)
class Ray:
    """A ray at an offset, in the cortex and in the medulla; lengths in radii."""

    hits: NDArray[np.bool_]
    gamma_i: Array
    gamma_t: Array
    gamma_c: Array
    gamma_m: Array
    h_m: Array
    cos_theta_t: Array
    cos_theta_m: Array
    cortex: Array
    medulla: Array
    reflected: Array
    """F_m"""


def ray_at(fibre: Yan2015Fibre, h: ArrayLike, theta: ArrayLike) -> Ray:
    """The ray at offsets h (...) and inclinations theta (...) [rad].

    Raises
    ------
    FibreError      one outside its range
    """
    h, theta = checked(h, theta)
    outer, inner = geometry(fibre, h, theta), geometry(fibre.medulla, h, theta)
    kappa = fibre.kappa
    hits = np.abs(outer.h_t) < kappa
    scale = kappa if kappa > 0.0 else 1.0
    sin_c = np.clip(outer.h_t / scale, -1.0, 1.0)
    sin_m = np.clip(inner.h_t / scale, -1.0, 1.0)
    # Fresnel's amplitudes by the cosines on both sides, times the indices.
    a = fibre.eta * outer.cos_theta_t * np.sqrt(1.0 - sin_c**2)
    b = fibre.eta_m * inner.cos_theta_t * np.sqrt(1.0 - sin_m**2)
    safe = np.where(a + b > 0.0, a + b, 1.0)
    ratio = (fibre.eta_m / fibre.eta) ** 2
    safe_p = np.where(ratio * a + b > 0.0, ratio * a + b, 1.0)
    f = 0.5 * (((a - b) / safe) ** 2 + ((ratio * a - b) / safe_p) ** 2)
    f = np.where(hits & (np.abs(inner.h_t) >= kappa), 1.0, np.where(hits, f, 0.0))
    return Ray(
        hits=hits,
        gamma_i=outer.gamma_i,
        gamma_t=outer.gamma_t,
        gamma_c=np.arcsin(sin_c),
        gamma_m=np.arcsin(sin_m),
        h_m=inner.h_t,
        cos_theta_t=outer.cos_theta_t,
        cos_theta_m=inner.cos_theta_t,
        cortex=outer.cortex,
        medulla=np.where(hits, inner.medulla, 0.0),
        reflected=f,
    )


def attenuations(
    fibre: Yan2015Fibre, h: ArrayLike, theta: ArrayLike, profiles: MedullaData, residual: bool
) -> dict[str, Array]:
    """A_p(h) (..., 3) of all lobes."""
    used = profiles_in_use(fibre.medulla, profiles)
    ray = ray_at(fibre, h, theta)
    f, passed = (x[..., None] for x in cuticle(fibre, h, theta))
    f_m, hits = ray.reflected[..., None], ray.hits[..., None]
    ca = np.asarray(fibre.sigma_ca) / ray.cos_theta_t[..., None]
    per_radius = 1.0 / ray.cos_theta_m[..., None]
    s_c, s_m = ray.cortex[..., None], ray.medulla[..., None]
    x = np.exp(-2.0 * s_c * ca)
    t_m = np.exp(-2.0 * s_m * (np.asarray(fibre.sigma_ma) + fibre.sigma_ms) * per_radius)
    out = {"R": f * np.ones(3)}
    for name, (inside, reflections, passages) in PATHS.items():
        if name in SCATTERED:
            continue
        a = passed**2 * f**inside * x ** (inside + 1)
        a = a * f_m**reflections * ((1.0 - f_m) ** 2 * t_m) ** passages
        a = a * (2.0 if name == "TrRtT" else 1.0)
        out[name] = np.where(hits == (name not in ("TT", "TRT")), a, 0.0)
    entering = np.zeros_like(x)
    if used is not None:
        q = -np.expm1(-2.0 * s_m * fibre.sigma_ms * per_radius)
        way = np.exp(-(s_c + 1.0 - fibre.kappa) * ca)
        let_out = scattered.escape(fibre.medulla, used, ray.cos_theta_m, ray.h_m)
        entering = np.where(hits, (1.0 - f_m) * q * way * let_out, 0.0)
    for name in SCATTERED:
        inside, reflections, passages = PATHS[name]
        before = (f * x) ** inside * f_m**reflections * ((1.0 - f_m) ** 2 * t_m) ** passages
        out[name] = passed * before * entering
    if residual:
        again = np.where(1.0 - f_m * t_m > 0.0, 1.0 - f_m * t_m, 1.0)
        back = x * np.where(hits, f_m + (1.0 - f_m) ** 2 * t_m / again, 1.0)
        out_s = entering / again
        one_minus = 1.0 - f * back
        safe = np.where(one_minus > 0.0, one_minus, 1.0)
        total = f + np.where(one_minus > 0.0, passed * (passed * back + out_s) / safe, 0.0)
        out[RESIDUAL] = np.maximum(total - np.sum(list(out.values()), axis=0), 0.0)
    return out


class _Yan2015(Shape):
    def __init__(self, fibre: Yan2015Fibre, residual: bool, profiles: MedullaData) -> None:
        self._fibre, self.residual = fibre, residual
        self._given = profiles
        self._used = None
        if fibre.has_medulla and profiles is not None:
            self._used = profiles_in_use(fibre.medulla, profiles)

    @property
    def names(self) -> tuple[str, ...]:
        return ("R", *PATHS, RESIDUAL)

    def attenuations(self, h: ArrayLike, theta: ArrayLike) -> dict[str, Array]:
        return attenuations(self._fibre, h, theta, self._given, self.residual)

    def edges(self, theta: float) -> tuple[float, ...]:
        return (medulla_edge(self._fibre, theta), medulla_edge(self._fibre.medulla, theta))

    def specular(self, name: str, h: Array, theta: Array) -> Array:
        """Azimuth at which smooth cylinders send a lobe [rad]; of a scattered one that of the ray
        in the medulla, turned by pi, from which its profile counts."""
        ray = ray_at(self._fibre, h, theta)
        first = ray.gamma_t - ray.gamma_i
        if name == "R":
            return -2.0 * ray.gamma_i
        inside, reflections, passages = PATHS[name]
        bend = ray.gamma_m - ray.gamma_c
        phi = inside * (np.pi + 2.0 * ray.gamma_t) + reflections * (np.pi - 2.0 * ray.gamma_c)
        phi = phi + 2.0 * passages * bend
        return phi + (first + bend if name in SCATTERED else np.pi + 2.0 * first)

    def centre(self, name: str, theta: Array, phi: Array) -> tuple[Array, Array]:
        inside = 1 if name == RESIDUAL else PATHS[name][0] if name != "R" else -1
        return centre_and_width(self._fibre, 1 + inside, theta, phi)

    def _width(self, name: str) -> float:
        return self._fibre.beta_n * np.sqrt(1.0 if name == "R" else 2.0 + PATHS[name][0])

    def _parts(self, name: str, theta: Array, theta_o: Array, phi: Array, h: Array) -> Any:
        """Of a scattered lobe: density of the azimuth, the same carrying absorption, density of
        s, and the share that escapes."""
        ray, medulla = ray_at(self._fibre, h, theta), self._fibre.medulla
        assert self._used is not None
        at = phi - self.specular(name, h, theta)
        density, carried = scattered.azimuthal(medulla, self._used, ray.cos_theta_m, ray.h_m, at)
        along = scattered.longitudinal(medulla, self._used, theta, np.sin(theta_o), phi)
        return (
            density,
            carried,
            along,
            scattered.escape(medulla, self._used, ray.cos_theta_m, ray.h_m),
        )

    def density(
        self, name: str, theta: Array, theta_o: Array, phi: Array, h: Array, uniform: bool
    ) -> Array:
        if name in SCATTERED:
            if uniform:
                return np.full(np.shape(phi), 0.25 / np.pi)
            if self._used is None:
                return np.zeros(np.shape(phi))
            azimuth, _, along, _ = self._parts(name, theta, theta_o, phi, h)
            return azimuth * along
        mu, beta = self.centre(name, theta, phi)
        along = longitudinal(theta_o, mu, beta * beta)
        if name == RESIDUAL:
            return along / (2.0 * np.pi)
        return along * wrapped_gaussian(phi - self.specular(name, h, theta), self._width(name))

    def value(
        self, name: str, a: Array, theta: Array, theta_o: Array, phi: Array, h: Array
    ) -> Array:
        if name not in SCATTERED:
            return super().value(name, a, theta, theta_o, phi, h)
        if self._used is None:
            return np.zeros_like(a)
        _, carried, along, escape = self._parts(name, theta, theta_o, phi, h)
        entering = np.divide(a, escape, out=np.zeros_like(a), where=escape > 0.0)
        return entering * carried * along[..., None]

    def value_over_density(
        self,
        name: str,
        a: Array,
        theta: Array,
        theta_o: Array,
        phi: Array,
        h: Array,
        density: Array,
    ) -> Array:
        if name not in SCATTERED:
            return a
        return self.value(name, a, theta, theta_o, phi, h) / density[..., None]

    def draw_direction(
        self, name: str, theta: Array, h: Array, uniform: bool, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        n = len(h)
        if name not in SCATTERED:
            return super().draw_direction(name, theta, h, uniform, rng)
        if uniform or self._used is None:
            return np.arcsin(rng.uniform(-1.0, 1.0, n)), rng.uniform(-np.pi, np.pi, n)
        ray, medulla = ray_at(self._fibre, h, theta), self._fibre.medulla
        phi = scattered.draw_azimuth(medulla, self._used, ray.cos_theta_m, ray.h_m, rng)
        phi = phi + self.specular(name, h, theta)
        return np.arcsin(scattered.draw_sine(medulla, self._used, theta, phi, rng)), phi

    def draw_turn(self, name: str, rng: np.random.Generator, n: int) -> Array:
        return self._width(name) * rng.standard_normal(n)


REFERENCE = Reference(_Yan2015)
evaluate = REFERENCE.evaluate
direction_pdf = REFERENCE.direction_pdf
pdf = REFERENCE.pdf
sample = REFERENCE.sample
attenuation = REFERENCE.attenuation
albedo = REFERENCE.albedo
lobe_shares = REFERENCE.lobe_shares
