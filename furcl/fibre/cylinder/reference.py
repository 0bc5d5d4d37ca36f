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

    @abstractmethod
    def variance(self, p: int) -> float:
        """Longitudinal variance of order p [rad^2]."""

    @abstractmethod
    def azimuth(self, angle: Array) -> Array:
        """Azimuthal density [1/rad] at an angle from the specular azimuth [rad]."""

    @abstractmethod
    def draw_azimuth(self, rng: np.random.Generator, n: int) -> Array:
        """(n,) angles [rad] of that density."""

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
    shape_of : callable     fibre, residual asked for -> Shape
    """

    def __init__(self, shape_of: Any) -> None:
        self._shape_of = shape_of

    def _density(self, shape: Shape, name: str, wo: Array, wi: Array, h: Array) -> Array:
        theta, phi_in = angles(wo)
        theta_o, phi_out = angles(wi)
        theta, theta_o, phi, h = np.broadcast_arrays(theta, theta_o, phi_out - phi_in, h)
        mu, beta = shape.centre(name, theta, phi)
        along = longitudinal(theta_o, mu, beta * beta)
        if name == RESIDUAL:
            return along / (2.0 * np.pi)
        angle = phi - specular(shape, shape.order(name), h, theta)
        return along * shape.azimuth(angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi)))

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
        shape = self._shape_of(fibre, residual or lobe is not None)
        wo, wi = unit_vectors("wo", wo), unit_vectors("wi", wi)
        h = np.asarray(h, np.float64)
        a = attenuations(shape, h, angles(wo)[0])
        names = list(a) if lobe is None else [self._name(shape, lobe)]
        total = sum(a[n] * self._density(shape, n, wo, wi, h)[..., None] for n in names)
        return np.asarray(total)

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
        sampling_name(sampling)
        shape = self._shape_of(fibre, True)
        wo, wi = unit_vectors("wo", wo), unit_vectors("wi", wi)
        return self._density(shape, self._name(shape, lobe), wo, wi, np.asarray(h, np.float64))

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
        shape = self._shape_of(fibre, residual)
        wo, wi = unit_vectors("wo", wo), unit_vectors("wi", wi)
        theta, h = np.broadcast_arrays(angles(wo)[0], np.asarray(h, np.float64))
        q = _choice(sampling, shape, theta.ravel()).densities(h.ravel())
        names = list(attenuations(shape, h, theta))
        asked = names if lobe is None else [self._name(shape, lobe)]
        total = sum(
            q[names.index(name)].reshape(h.shape) * self._density(shape, name, wo, wi, h)
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
        shape = self._shape_of(fibre, residual)
        rng = np.random.default_rng(rng)
        wo = unit_vectors("wo", wo)
        wo = np.atleast_2d(wo) if n is None else np.broadcast_to(wo, (n, 3))
        theta, azimuth = angles(wo)
        choice = _choice(sampling, shape, theta)
        place, h = choice.draw(rng)
        a = attenuations(shape, h, theta)
        q = choice.densities(h)
        wi, weight, density = np.zeros(wo.shape), np.zeros(wo.shape), np.zeros(len(wo))
        lobe = np.full(len(wo), len(shape.names))
        for index, name in enumerate(a):
            mine = np.flatnonzero(place == index)
            if name == RESIDUAL:
                phi = rng.uniform(-np.pi, np.pi, len(mine))
            else:
                phi = specular(shape, shape.order(name), h[mine], theta[mine])
                phi = phi + shape.draw_azimuth(rng, len(mine))
            mu, beta = shape.centre(name, theta[mine], phi)
            out = draw_inclination(mu, beta, rng)
            phi = azimuth[mine] + phi
            cos = np.cos(out)
            wi[mine] = np.stack([np.sin(out), cos * np.cos(phi), cos * np.sin(phi)], 1)
            weight[mine] = 0.5 * a[name][mine] / q[index, mine, None]
            density[mine] = q[index, mine] * self._density(shape, name, wo[mine], wi[mine], h[mine])
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
        return attenuations(self._shape_of(fibre, residual), h, theta_in)

    def albedo(
        self,
        fibre: Any,
        theta: ArrayLike,
        profiles: Any = None,
        n: int = 64,
        residual: bool = False,
    ) -> Array:
        """Directional albedo (..., 3)."""
        return np.sum(list(self._albedos(fibre, theta, n, residual).values()), axis=0)

    def lobe_shares(
        self, fibre: Any, profiles: Any = None, residual: bool = False
    ) -> dict[str, float]:
        """Share of each lobe in what isotropically oriented fibres return."""
        x, w = np.polynomial.legendre.leggauss(48)
        theta = np.pi / 4 * (x + 1.0)
        lobes = self._albedos(fibre, theta, 64, residual)
        energy = np.stack([albedo.mean(-1) for albedo in lobes.values()])
        weight = w * np.cos(theta) ** 2
        shares = (energy / energy.sum(0)) @ weight / weight.sum()
        return {name: float(share) for name, share in zip(lobes, shares, strict=True)}

    def _albedos(self, fibre: Any, theta: ArrayLike, n: int, residual: bool) -> dict[str, Array]:
        theta = np.asarray(theta, np.float64)
        h, w = _nodes(1, n)
        a = attenuations(self._shape_of(fibre, residual), h[0], theta[..., None])
        return {name: np.einsum("n,...nc->...c", w[0], row) for name, row in a.items()}

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
        share = np.stack([a.mean(-1) for a in attenuations(self._shape, h, self._theta).values()])
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
            a = attenuations(shape, h, t)
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
