"""Float64 reference of cylinders without a medulla, written from the equations of the models.

f(wo, wi | h) = sum over p of A_p(h) D_p(phi - Phi_p(h)) m_p(s), as for the double cylinder
(furcl.fibre.double_cylinder.reference has the conventions). A model gives widths and the azimuthal
density by a subclass of `Shape`; `Reference` has the functions that every model's reference has.
Nothing here is shared with the kernels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.reference.angles import MIN_BETA, longitudinal
from furcl.fibre.double_cylinder.reference.draws import Indices, pick, place_in_row
from furcl.fibre.double_cylinder.reference.pairs import angles, sampling_name, unit_vectors
from furcl.fibre.double_cylinder.reference.sampling import Samples, draw_inclination

Array = NDArray[np.float64]

BINS = 100
"""Bins over |h|, A_p being even: the paper's 200 over h."""

NODES = 16
"""Gauss-Legendre nodes in each bin."""

RESIDUAL = "residual"


class Shape(ABC):
    """What one fibre of a model is made of."""

    eta: float
    sigma_a: tuple[float, float, float]
    tilt: float
    orders: int
    residual: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Lobes in the order of their indices: R, TT, TRT, the residual, TRRT and later."""
        later = [f"T{'R' * (p - 1)}T" for p in range(3, self.orders)]
        return ("R", "TT", "TRT", RESIDUAL, *later)

    def order(self, name: str) -> int:
        """Stretches inside the fibre."""
        return 0 if name == "R" else len(name) - 1

    def attenuations(self, h: ArrayLike, theta: ArrayLike) -> dict[str, Array]:
        """A_p(h) (..., 3) of the lobes that there are."""
        return attenuations(self, h, theta)

    def edges(self, theta: float) -> tuple[float, ...]:
        """Offsets |h| at which attenuations have edges; those above 1 do not count."""
        return ()

    def variance(self, p: int) -> float:
        """Longitudinal variance of order p [rad^2]."""
        raise NotImplementedError

    def azimuth(self, angle: Array) -> Array:
        """Azimuthal density [1/rad] at an angle from the specular azimuth [rad]."""
        raise NotImplementedError

    @abstractmethod
    def draw_turn(self, name: str, rng: np.random.Generator, n: int) -> Array:
        """(n,) angles [rad] from the specular azimuth of a lobe, of its density."""

    def specular(self, name: str, h: Array, theta: Array) -> Array:
        """Specular azimuth of a lobe [rad]."""
        return specular(self, self.order(name), h, theta)

    def density(
        self, name: str, theta: Array, theta_o: Array, phi: Array, h: Array, uniform: bool
    ) -> Array:
        """Density (...) [1/sr] of a lobe's directions; `uniform`: lobes that have profiles go into
        all directions alike."""
        mu, beta = self.centre(name, theta, phi)
        along = longitudinal(theta_o, mu, beta * beta)
        if name == RESIDUAL:
            return along / (2.0 * np.pi)
        angle = phi - self.specular(name, h, theta)
        return along * self.azimuth(angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi)))

    def value(
        self, name: str, a: Array, theta: Array, theta_o: Array, phi: Array, h: Array
    ) -> Array:
        """Value (..., 3) [1/sr] of a lobe of attenuation a (..., 3)."""
        return a * self.density(name, theta, theta_o, phi, h, False)[..., None]

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
        """`value` over the density (...) with which a direction was drawn."""
        return a

    def draw_direction(
        self, name: str, theta: Array, h: Array, uniform: bool, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Inclinations and azimuths (n,) [rad] of the density of a lobe."""
        n = len(h)
        if name == RESIDUAL:
            phi = rng.uniform(-np.pi, np.pi, n)
        else:
            phi = self.specular(name, h, theta) + self.draw_turn(name, rng, n)
        mu, beta = self.centre(name, theta, phi)
        return draw_inclination(mu, beta, rng), phi

    def centre(self, name: str, theta: Array, phi: Array) -> tuple[Array, Array]:
        """Longitudinal centre and width (...) [rad] of a lobe."""
        p = 3 if name == RESIDUAL else self.order(name)
        shift = (2.0, -1.0, -4.0, 0.0)[min(p, 3)] * self.tilt
        beta = max(float(np.sqrt(self.variance(p))), MIN_BETA)
        return shift - theta, np.full(np.shape(theta), beta)


def fresnel(eta: float, h: Array, theta: Array) -> tuple[Array, Array]:
    """Reflectance of the surface at an offset and its complement, mean of both polarisations.

    By the amplitudes (a - b) / (a + b), of which 1 - r^2 = 4 a b / (a + b)^2 does not cancel.
    """
    cos_a = np.cos(theta) * np.sqrt((1.0 - h) * (1.0 + h))
    cos_b = np.sqrt((eta - 1.0) * (eta + 1.0) + cos_a**2) / eta
    pairs = ((cos_a, eta * cos_b), (eta * cos_a, cos_b))
    reflected = sum(((a - b) / (a + b)) ** 2 for a, b in pairs)
    passed = sum(4.0 * a * b / (a + b) ** 2 for a, b in pairs)
    return 0.5 * np.asarray(reflected), 0.5 * np.asarray(passed)


def attenuations(shape: Shape, h: ArrayLike, theta: ArrayLike) -> dict[str, Array]:
    """A_p(h) (..., 3) of all lobes: F, (1-F)^2 F^(p-1) T^p, and in the residual what is left."""
    h, theta = np.broadcast_arrays(np.asarray(h, np.float64), np.asarray(theta, np.float64))
    if not np.all(np.abs(h) <= 1.0) or not np.all(np.abs(theta) <= np.pi / 2):
        raise FibreError("bcsdf: h is allowed in [-1, 1], theta in [-pi/2, pi/2] radians")
    f, passed = (x[..., None] for x in fresnel(shape.eta, h, theta))
    cos_t = np.sqrt((shape.eta - 1.0) * (shape.eta + 1.0) + np.cos(theta) ** 2) / shape.eta
    sin_g = h * np.cos(theta) / (shape.eta * cos_t)
    chord = 2.0 * np.sqrt((1.0 - sin_g) * (1.0 + sin_g)) / cos_t
    log_t = -chord[..., None] * np.asarray(shape.sigma_a)
    out = {"R": f * np.ones(3)}
    for p in range(1, shape.orders):
        out[f"T{'R' * (p - 1)}T"] = passed**2 * f ** (p - 1) * np.exp(p * log_t)
    if shape.residual:
        one_minus_ft = passed - f * np.expm1(log_t)
        safe = np.where(one_minus_ft > 0.0, one_minus_ft, 1.0)
        later = passed**2 / safe * f ** (shape.orders - 1) * np.exp(shape.orders * log_t)
        out[RESIDUAL] = np.where(one_minus_ft > 0.0, later, 0.0)
    return {name: out[name] for name in shape.names if name in out}


def specular(shape: Shape, p: int, h: Array, theta: Array) -> Array:
    """Phi_p(h) [rad]."""
    eta_prime = np.sqrt((shape.eta - 1.0) * (shape.eta + 1.0) + np.cos(theta) ** 2)
    gamma_t = np.arcsin(h * np.cos(theta) / eta_prime)
    return 2.0 * p * gamma_t - 2.0 * np.arcsin(h) + p * np.pi


class Reference:
    """The functions of a model's reference; docs/oracle.md says what each takes and gives.

    Parameters
    ----------
    shape_of : callable     fibre, residual asked for, what the model prepared -> Shape
    """

    def __init__(self, shape_of: Any) -> None:
        self._shape_of = shape_of

    @staticmethod
    def _pair(wo: ArrayLike, wi: ArrayLike, h: ArrayLike) -> tuple[Array, ...]:
        """theta of wo, theta of wi, azimuth between them, h, of one shape."""
        theta, phi_in = angles(unit_vectors("wo", wo))
        theta_o, phi_out = angles(unit_vectors("wi", wi))
        h = np.asarray(h, np.float64)
        theta, theta_o, phi, h = np.broadcast_arrays(theta, theta_o, phi_out - phi_in, h)
        return theta, theta_o, phi, h

    def evaluate(
        self,
        fibre: Any,
        wo: ArrayLike,
        wi: ArrayLike,
        h: ArrayLike,
        profiles: Any = None,
        lobe: Any = None,
        residual: bool = False,
    ) -> Array:
        """Value (..., 3) [1/sr] at a fixed offset, the cosine included."""
        shape = self._shape_of(fibre, residual or lobe is not None, profiles)
        theta, theta_o, phi, h = self._pair(wo, wi, h)
        a = shape.attenuations(h, theta)
        names = list(a) if lobe is None else [self._name(shape, lobe)]
        return np.asarray(sum(shape.value(n, a[n], theta, theta_o, phi, h) for n in names))

    def direction_pdf(
        self,
        fibre: Any,
        wo: ArrayLike,
        wi: ArrayLike,
        h: ArrayLike,
        profiles: Any = None,
        *,
        lobe: Any,
        sampling: str,
    ) -> Array:
        """Density (...) [1/sr] of wi once lobe and offset are chosen."""
        shape = self._shape_of(fibre, True, profiles)
        pair, uniform = self._pair(wo, wi, h), sampling_name(sampling) != "full-cdf"
        return shape.density(self._name(shape, lobe), *pair, uniform)

    def pdf(
        self,
        fibre: Any,
        wo: ArrayLike,
        wi: ArrayLike,
        h: ArrayLike,
        profiles: Any,
        /,
        *,
        sampling: str,
        lobe: Any = None,
        residual: bool = False,
    ) -> Array:
        """Density (...) of (lobe, h, wi) [1/sr per unit of h], or of (h, wi) for lobe = None."""
        shape = self._shape_of(fibre, residual, profiles)
        pair, uniform = self._pair(wo, wi, h), sampling_name(sampling) != "full-cdf"
        theta, _, _, h = pair
        q = _choice(sampling, shape, theta.ravel()).densities(h.ravel())
        names = list(shape.attenuations(h, theta))
        asked = names if lobe is None else [self._name(shape, lobe)]
        total = sum(
            q[names.index(name)].reshape(h.shape) * shape.density(name, *pair, uniform)
            for name in asked
        )
        return np.asarray(total)

    def sample(
        self,
        fibre: Any,
        wo: ArrayLike,
        n: int | None = None,
        profiles: Any = None,
        *,
        sampling: str,
        rng: Any,
        residual: bool = False,
    ) -> Samples:
        """Draws of lobe, offset and direction."""
        shape = self._shape_of(fibre, residual, profiles)
        uniform = sampling_name(sampling) != "full-cdf"
        rng = np.random.default_rng(rng)
        wo = unit_vectors("wo", wo)
        wo = np.atleast_2d(wo) if n is None else np.broadcast_to(wo, (n, 3))
        theta, azimuth = angles(wo)
        choice = _choice(sampling, shape, theta)
        place, h = choice.draw(rng)
        a = shape.attenuations(h, theta)
        q = choice.densities(h)
        wi, weight, density = np.zeros(wo.shape), np.zeros(wo.shape), np.zeros(len(wo))
        lobe = np.full(len(wo), len(shape.names))
        for index, name in enumerate(a):
            mine = np.flatnonzero(place == index)
            at, offset = theta[mine], h[mine]
            out, phi = shape.draw_direction(name, at, offset, uniform, rng)
            turned, cos = azimuth[mine] + phi, np.cos(out)
            wi[mine] = np.stack([np.sin(out), cos * np.cos(turned), cos * np.sin(turned)], 1)
            of_lobe = shape.density(name, at, out, phi, offset, uniform)
            energy = shape.value_over_density(name, a[name][mine], at, out, phi, offset, of_lobe)
            weight[mine] = 0.5 * energy / q[index, mine, None]
            density[mine] = q[index, mine] * of_lobe
            lobe[mine] = shape.names.index(name)
        return Samples(wi, h, lobe, weight, density)

    def attenuation(
        self,
        fibre: Any,
        h: ArrayLike,
        theta_in: ArrayLike,
        profiles: Any = None,
        residual: bool = False,
    ) -> dict[str, Array]:
        """Energy of every lobe at offsets h: name -> (..., 3)."""
        return self._shape_of(fibre, residual, profiles).attenuations(h, theta_in)

    def albedo(
        self,
        fibre: Any,
        theta: ArrayLike,
        profiles: Any = None,
        n: int = 64,
        residual: bool = False,
    ) -> Array:
        """Directional albedo (..., 3)."""
        return np.sum(list(self._albedos(fibre, theta, profiles, n, residual).values()), axis=0)

    def lobe_shares(
        self, fibre: Any, profiles: Any = None, residual: bool = False
    ) -> dict[str, float]:
        """Share of each lobe in what isotropically oriented fibres return."""
        x, w = np.polynomial.legendre.leggauss(48)
        theta = np.pi / 4 * (x + 1.0)
        lobes = self._albedos(fibre, theta, profiles, 64, residual)
        energy = np.stack([albedo.mean(-1) for albedo in lobes.values()])
        weight = w * np.cos(theta) ** 2
        shares = (energy / energy.sum(0)) @ weight / weight.sum()
        return {name: float(share) for name, share in zip(lobes, shares, strict=True)}

    def _albedos(
        self, fibre: Any, theta: ArrayLike, profiles: Any, n: int, residual: bool
    ) -> dict[str, Array]:
        theta = np.asarray(theta, np.float64)
        shape = self._shape_of(fibre, residual, profiles)
        rows: dict[str, list[Array]] = {}
        for angle in theta.ravel():
            inside = [edge for edge in shape.edges(float(angle)) if 0.0 < edge < 1.0]
            cuts = np.array([0.0, *sorted(inside), 1.0])
            h, w = _nodes(1, n)
            h = cuts[:-1, None] + np.diff(cuts)[:, None] * h
            w = np.diff(cuts)[:, None] * w
            for name, a in shape.attenuations(h, angle).items():
                rows.setdefault(name, []).append(np.einsum("pn,pnc->c", w, a))
        return {name: np.reshape(row, (*theta.shape, 3)) for name, row in rows.items()}

    @staticmethod
    def _name(shape: Shape, lobe: Any) -> str:
        names = shape.names
        if lobe in names:
            return lobe
        if isinstance(lobe, int | np.integer) and 0 <= lobe < len(names):
            return names[lobe]
        raise FibreError(f"bcsdf: lobe {lobe!r} is not known - allowed are {', '.join(names)}")


def _nodes(bins: int, n: int) -> tuple[Array, Array]:
    """Nodes and weights (bins, n) over h in [0, 1] in even bins; in each h runs as sin^2."""
    x, w = np.polynomial.legendre.leggauss(n)
    angle = np.pi / 4 * (x + 1.0)
    low = np.arange(bins)[:, None] / bins
    return low + np.sin(angle) ** 2 / bins, np.broadcast_to(
        np.sin(2.0 * angle) * w * np.pi / 4 / bins, (bins, n)
    )


class _UniformOffset:
    """h uniform, then the lobe in proportion to A_p(h), mean of the channels."""

    def __init__(self, shape: Shape, theta: Array) -> None:
        self._shape, self._theta = shape, theta

    def densities(self, h: Array) -> Array:
        lobes = self._shape.attenuations(h, self._theta)
        share = np.stack([a.mean(-1) for a in lobes.values()])
        return 0.5 * share / share.sum(0)

    def draw(self, rng: np.random.Generator) -> tuple[Indices, Array]:
        h = rng.uniform(-1.0, 1.0, self._theta.shape)
        return pick(2.0 * self.densities(h), rng), h


class _BinnedOffset:
    """The lobe by the integral of its attenuation, then h by the lobe's bins, uniform inside."""

    def __init__(self, shape: Shape, theta: Array) -> None:
        inclinations, self._row = np.unique(np.abs(theta), return_inverse=True)
        h, w = _nodes(BINS, NODES)
        rows = []
        for t in inclinations:
            a = shape.attenuations(h, t)
            rows.append([(x.mean(-1) * w).sum(1) * BINS for x in a.values()])
        self._means = np.array(rows)
        self._albedo = self._means.mean(2).sum(1)

    def densities(self, h: Array) -> Array:
        bins = np.minimum((np.abs(h) * BINS).astype(np.intp), BINS - 1)
        return 0.5 * self._means[self._row, :, bins].T / self._albedo[self._row]

    def draw(self, rng: np.random.Generator) -> tuple[Indices, Array]:
        rows = self._means.reshape(len(self._albedo), -1)
        at, inside = place_in_row(rows, self._row, rng)
        lobe, bins = np.divmod(at, BINS)
        size = np.minimum((bins + inside) / BINS, 1.0)
        return lobe, np.where(rng.random(size.shape) < 0.5, -size, size)


def _choice(sampling: str, shape: Shape, theta: Array) -> _UniformOffset | _BinnedOffset:
    kind = _UniformOffset if sampling_name(sampling) == "uniform-h" else _BinnedOffset
    return kind(shape, theta)
