"""Float64 reference of models whose scattering function knows no offset h.

Of the offset that samplers draw only the lobe's share at the inclination is left; evaluate, pdf and
direction_pdf take h and ignore it. A model says the rest by a subclass of `Closed`. Nothing here is
shared with the kernels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from furcl.errors import FibreError
from furcl.fibre.double_cylinder.reference.draws import pick
from furcl.fibre.double_cylinder.reference.pairs import angles, sampling_name, unit_vectors
from furcl.fibre.double_cylinder.reference.sampling import Samples

Array = NDArray[np.float64]

LEAST_COS = 1e-4
"""Nearer to the axis than this, in cosines of inclinations, values and densities are those at it:
on the axis both have a pole."""


class Closed(ABC):
    """What one fibre of a model is made of: values and draws of each lobe.

    Angles are arrays of one shape: theta of wo, theta_o of wi, azimuth phi of wi from wo [rad].
    """

    names: tuple[str, ...]

    @abstractmethod
    def energy(self, name: str, theta: Array) -> Array:
        """(..., 3): the lobe is chosen in proportion to the mean of the channels."""

    @abstractmethod
    def value(self, name: str, theta: Array, theta_o: Array, phi: Array) -> Array:
        """(..., 3) [1/sr], the cosine of theta_o included."""

    @abstractmethod
    def density(
        self, name: str, theta: Array, theta_o: Array, phi: Array, by_attenuation: bool
    ) -> Array:
        """(...) [1/sr] of drawing wi, the lobe being chosen."""

    @abstractmethod
    def draw(
        self, name: str, theta: Array, rng: np.random.Generator, by_attenuation: bool
    ) -> tuple[Array, Array]:
        """theta_o and phi (n,) of that density; theta_o past a pole is lost light."""

    @abstractmethod
    def albedo(self, name: str, theta: Array) -> Array:
        """(..., 3): the integral of the value over all wi, by quadrature."""


class ClosedReference:
    """The functions of a model's reference; docs/oracle.md says what each takes and gives.

    Parameters
    ----------
    closed_of : callable    fibre -> Closed
    """

    def __init__(self, closed_of: Callable[[Any], Closed]) -> None:
        self._of = lru_cache(maxsize=8)(closed_of)

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
        """Value (..., 3) [1/sr], the same at every offset, the cosine included."""
        closed = self._of(fibre)
        theta, theta_o, phi, _ = _angles(wo, wi, h)
        names = closed.names if lobe is None else [_name(closed, lobe)]
        return np.asarray(sum(closed.value(name, theta, theta_o, phi) for name in names))

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
        """Density (...) [1/sr] of wi once the lobe is chosen."""
        closed = self._of(fibre)
        theta, theta_o, phi, _ = _angles(wo, wi, h)
        by_attenuation = sampling_name(sampling) != "uniform-h"
        return closed.density(_name(closed, lobe), theta, theta_o, phi, by_attenuation)

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
        closed = self._of(fibre)
        share = dict(zip(closed.names, _shares(closed, _angles(wo, wi, h)[0]), strict=True))
        names = closed.names if lobe is None else [_name(closed, lobe)]
        given = {"lobe": None, "sampling": sampling}
        total = sum(
            0.5 * share[name] * self.direction_pdf(fibre, wo, wi, h, **(given | {"lobe": name}))
            for name in names
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
        closed = self._of(fibre)
        by_attenuation = sampling_name(sampling) != "uniform-h"
        rng = np.random.default_rng(rng)
        wo = unit_vectors("wo", wo)
        wo = np.atleast_2d(wo) if n is None else np.broadcast_to(wo, (n, 3))
        theta, azimuth = angles(wo)
        share = _shares(closed, theta)
        lobe = np.where(share.sum(0) > 0.0, pick(share, rng), len(closed.names))
        h = rng.uniform(-1.0, 1.0, len(wo))
        wi, weight, density = np.zeros(wo.shape), np.zeros(wo.shape), np.zeros(len(wo))
        for index, name in enumerate(closed.names):
            mine = np.flatnonzero(lobe == index)
            out, phi = closed.draw(name, theta[mine], rng, by_attenuation)
            lost = np.abs(out) >= np.pi / 2
            out = np.clip(out, -np.pi / 2, np.pi / 2)
            cos = np.where(lost, 0.0, np.cos(out))
            turned = azimuth[mine] + phi
            wi[mine] = np.stack([np.sin(out), cos * np.cos(turned), cos * np.sin(turned)], 1)
            at = (name, theta[mine], out, phi)
            of_wi = share[index, mine] * closed.density(*at, by_attenuation)
            value = closed.value(*at) * ~lost[:, None]
            weight[mine] = np.divide(
                value, of_wi[:, None], out=np.zeros_like(value), where=of_wi[:, None] > 0.0
            )
            density[mine] = 0.5 * of_wi
        return Samples(wi, h, lobe, weight, density)

    def attenuation(
        self,
        fibre: Any,
        h: ArrayLike,
        theta_in: ArrayLike,
        profiles: Any = None,
        residual: bool = False,
    ) -> dict[str, Array]:
        """About the energy of every lobe, by which it is chosen: name -> (..., 3); the same at
        every offset."""
        closed = self._of(fibre)
        h, theta = np.broadcast_arrays(np.asarray(h, np.float64), np.asarray(theta_in, np.float64))
        if not np.all(np.abs(h) <= 1.0) or not np.all(np.abs(theta) <= np.pi / 2):
            raise FibreError("bcsdf: h is allowed in [-1, 1], theta in [-pi/2, pi/2] radians")
        return {name: closed.energy(name, theta) for name in closed.names}

    def albedo(
        self,
        fibre: Any,
        theta: ArrayLike,
        profiles: Any = None,
        n: int = 64,
        residual: bool = False,
    ) -> Array:
        """Directional albedo (..., 3), by a quadrature of the model's own."""
        closed = self._of(fibre)
        theta = np.asarray(theta, np.float64)
        return np.sum([closed.albedo(name, theta) for name in closed.names], axis=0)

    def lobe_shares(
        self, fibre: Any, profiles: Any = None, residual: bool = False
    ) -> dict[str, float]:
        """Share of each lobe in what isotropically oriented fibres return."""
        closed = self._of(fibre)
        x, w = np.polynomial.legendre.leggauss(24)
        theta = np.pi / 4 * (x + 1.0)
        # Both ways along the fibre: shifts make them differ.
        both = np.concatenate([theta, -theta])
        energy = np.stack([closed.albedo(name, both).mean(-1) for name in closed.names])
        weight = np.concatenate([w, w]) * np.cos(both) ** 2
        shares = (energy / energy.sum(0)) @ weight / weight.sum()
        return {name: float(share) for name, share in zip(closed.names, shares, strict=True)}


def _angles(wo: ArrayLike, wi: ArrayLike, h: ArrayLike) -> list[Array]:
    """theta, theta_o, phi and h, of one shape."""
    theta, phi_in = angles(unit_vectors("wo", wo))
    theta_o, phi_out = angles(unit_vectors("wi", wi))
    return list(np.broadcast_arrays(theta, theta_o, phi_out - phi_in, np.asarray(h, np.float64)))


def _shares(closed: Closed, theta: Array) -> Array:
    """(lobes, ...) with what chance each lobe is chosen."""
    energy = np.stack([closed.energy(name, theta).mean(-1) for name in closed.names])
    total = energy.sum(0)
    return np.divide(energy, total, out=np.zeros_like(energy), where=total > 0.0)


def _name(closed: Closed, lobe: Any) -> str:
    if lobe in closed.names:
        return lobe
    if isinstance(lobe, int | np.integer) and 0 <= lobe < len(closed.names):
        return closed.names[lobe]
    raise FibreError(f"bcsdf: lobe {lobe!r} is not known - allowed are {', '.join(closed.names)}")
