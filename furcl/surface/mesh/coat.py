"""A rough dielectric coat over a diffuse base, and the table of what it reflects.

The coat is one layer of GGX microfacets (Walter et al. 2007) with Smith's height-correlated masking
(Heitz 2014) and the Fresnel reflectance of a dielectric. The base is coupled to it as by Kelemen
and Szirmay-Kalos (2001): it reflects what the coat does not,

    albedo (1 - E(cos i)) (1 - E(cos o)) / (pi (1 - E_mean)),

where E is the coat's directional albedo and E_mean its mean over the hemisphere by the cosine. Both
are reciprocal, and a white base under any coat reflects all light. The kernel:
kernels/include/surface/coat.clh.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Nodes of the table, at cosines (i / (N - 1))^2: it is steep where the coat is seen at an angle.
COAT_NODES = 128
#: Words in front of the table: eta, alpha, 1 / (1 - E_mean), and one that is unused.
COAT_HEAD = 4

ETA_RANGE = (1.0, 3.0)
ROUGHNESS_RANGE = (0.1, 1.0)

# Nodes a dimension of the quadrature of a directional albedo.
_QUADRATURE = 96
# Seen at a cosine of 0 the albedo is a limit, taken here.
_GRAZING = 1e-6


@dataclass(frozen=True)
class Coat:
    """A coat.

    Attributes
    ----------
    eta : float         index of refraction over that outside, in ETA_RANGE
    roughness : float   in ROUGHNESS_RANGE; its square is GGX's alpha
    """

    eta: float = 1.4
    roughness: float = 0.4

    @property
    def alpha(self) -> float:
        """Root mean square slope of the microfacets, as GGX counts it."""
        return self.roughness**2

    def albedos(self) -> Array:
        """E at the nodes of the table, (COAT_NODES,).

        Between the nodes the table is linear in the root of the cosine. It is off the true albedo
        by less than 1e-3 (tests/test_coat.py).
        """
        return _albedos(self.eta, self.alpha)

    def mean_albedo(self) -> float:
        """E_mean of the interpolated table, exactly: so the base loses nothing to the table."""
        nodes = np.linspace(0.0, 1.0, COAT_NODES)
        at, weights = np.polynomial.legendre.leggauss(3)
        x = nodes[:-1, None] + 0.5 * (at + 1.0) / (COAT_NODES - 1)
        albedo = np.interp(x, nodes, self.albedos())
        return float((4.0 * albedo * x**3 * weights).sum() * 0.5 / (COAT_NODES - 1))

    def record(self) -> NDArray[np.float32]:
        """What the kernel reads, (COAT_HEAD + COAT_NODES,)."""
        head = [self.eta, self.alpha, 1.0 / (1.0 - self.mean_albedo()), 0.0]
        return np.concatenate([head, self.albedos()]).astype(np.float32)


def fresnel(cosine: Array, eta: float) -> Array:
    """Reflectance of unpolarised light at a dielectric of eta >= 1, seen at a cosine in [0, 1]."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    across = (cosine - eta * inside) / (cosine + eta * inside)
    along = (eta * cosine - inside) / (eta * cosine + inside)
    return 0.5 * (across**2 + along**2)


def _masking(cosine: Array, alpha: float) -> Array:
    """Smith's Lambda of GGX."""
    square = cosine**2
    return 0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 - square) / square) - 1.0)


@lru_cache(maxsize=64)
def _albedos(eta: float, alpha: float) -> Array:
    """Mean of F G2 / G1 over normals that are seen, drawn as by Dupuy and Benyoub (2023)."""
    nodes, weights = np.polynomial.legendre.leggauss(_QUADRATURE)
    height, weight = 0.5 * (nodes[:, None] + 1.0), 0.5 * weights[:, None] / _QUADRATURE
    # The integrand is even in the azimuth.
    phi = (np.arange(_QUADRATURE) + 0.5) * (np.pi / _QUADRATURE)
    out = np.zeros(COAT_NODES)
    for i, root in enumerate(np.linspace(0.0, 1.0, COAT_NODES)):
        cos_o = max(root**2, _GRAZING)
        sin_o = np.sqrt(1.0 - cos_o**2)
        stretched = np.array([alpha * sin_o, cos_o]) / np.hypot(alpha * sin_o, cos_o)
        z = (1.0 - height) * (1.0 + stretched[1]) - stretched[1]
        level = np.sqrt(np.maximum(1.0 - z * z, 0.0))
        normal = np.stack(
            np.broadcast_arrays(
                alpha * (level * np.cos(phi) + stretched[0]),
                alpha * level * np.sin(phi),
                z + stretched[1],
            )
        )
        normal /= np.linalg.norm(normal, axis=0)
        towards = np.clip(normal[0] * sin_o + normal[2] * cos_o, 0.0, 1.0)
        cos_i = 2.0 * towards * normal[2] - cos_o
        above = cos_i > 0.0
        masked = _masking(np.array(cos_o), alpha)
        seen = (1.0 + masked) / (1.0 + masked + _masking(np.where(above, cos_i, 1.0), alpha))
        out[i] = (weight * np.where(above, fresnel(towards, eta) * seen, 0.0)).sum()
    out.setflags(write=False)
    return out
