"""Float64 reference of the fibre's scattering function, written from the model's equations.

The double-cylinder model of Yan et al. 2015 and 2017 with the choices listed in docs/model.md.
Nothing here is shared with the kernels: it is what they are tested against, and an oracle for other
renderers.

Directions are unit vectors (x along the fibre, root to tip) pointing away from it: `wo` is the
known one (to the camera, "in" of the model), `wi` the one that is integrated over. Values include
the cosine: radiance along wo is the integral over solid angle of the value times the incident
radiance, averaged over the offset h in [-1, 1]; nothing is divided by a cosine.

h = sin(gamma_i) with gamma_i = phi_in - phi_normal, the azimuths counted from y towards z about the
tangent. For a hit at q (relative to the axis, over the radius) h = -dot(q, e_perp) with
e_perp = (-sin phi_in, cos phi_in) in the y, z plane.
"""

from furcl.fibre.double_cylinder.reference.angles import D_p, cone, m_p
from furcl.fibre.double_cylinder.reference.energy import (
    albedo,
    attenuation_tables,
    lobe_albedos,
    lobe_shares,
)
from furcl.fibre.double_cylinder.reference.model import evaluate, pdf
from furcl.fibre.double_cylinder.reference.optics import (
    LOBES,
    RESIDUAL,
    Geometry,
    attenuation,
    cuticle,
    geometry,
)

__all__ = [
    "LOBES",
    "RESIDUAL",
    "D_p",
    "Geometry",
    "albedo",
    "attenuation",
    "attenuation_tables",
    "cone",
    "cuticle",
    "evaluate",
    "geometry",
    "lobe_albedos",
    "lobe_shares",
    "m_p",
    "pdf",
]
