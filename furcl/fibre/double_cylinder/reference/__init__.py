"""Float64 reference of the fibre's scattering function, written from the model's equations.

The double-cylinder model of Yan et al. 2015 and 2017 with the choices listed in docs/model.md, and
the samplers of Shibaike and Iwasaki and of d'Eon et al. for it. Nothing here is shared with the
kernels or their tables: it is what they are tested against, and an oracle for other renderers
(docs/oracle.md).

Directions are unit vectors (x along the fibre, root to tip) pointing away from it: `wo` is the
known one (to the camera, "in" of the model: theta_i is its inclination), `wi` the one that is
integrated over or sampled. Values include the cosine: radiance along wo is the integral over solid
angle of the value times the incident radiance, averaged over the offset h in [-1, 1]; nothing is
divided by a cosine.

h = sin(gamma_i) with gamma_i = phi_in - phi_normal, the azimuths counted from y towards z about the
tangent. For a hit at q (relative to the axis, over the radius) h = -dot(q, e_perp) with
e_perp = (-sin phi_in, cos phi_in) in the y, z plane.

`pdf` is the joint density of (lobe, h, wi), `direction_pdf` that of wi once lobe and h are known.
Lobes that the medulla scatters need its profiles; without them there is an error, not a darker
fibre, unless UNSCATTERED is given in their place.
"""

from furcl.fibre.double_cylinder.reference.angles import D_p, cone, m_p
from furcl.fibre.double_cylinder.reference.energy import (
    albedo,
    attenuation_tables,
    lobe_albedos,
    lobe_shares,
)
from furcl.fibre.double_cylinder.reference.far_field import far_field, offsets_at_azimuth
from furcl.fibre.double_cylinder.reference.model import direction_pdf, evaluate
from furcl.fibre.double_cylinder.reference.offsets import joint_densities
from furcl.fibre.double_cylinder.reference.optics import (
    LOBES,
    RESIDUAL,
    SCATTERED,
    Geometry,
    attenuation,
    cuticle,
    geometry,
)
from furcl.fibre.double_cylinder.reference.pairs import SAMPLING
from furcl.fibre.double_cylinder.reference.profiles import UNSCATTERED
from furcl.fibre.double_cylinder.reference.sampling import Samples, pdf, sample

__all__ = [
    "LOBES",
    "RESIDUAL",
    "SAMPLING",
    "SCATTERED",
    "UNSCATTERED",
    "D_p",
    "Geometry",
    "Samples",
    "albedo",
    "attenuation",
    "attenuation_tables",
    "cone",
    "cuticle",
    "direction_pdf",
    "evaluate",
    "far_field",
    "geometry",
    "joint_densities",
    "lobe_albedos",
    "lobe_shares",
    "m_p",
    "offsets_at_azimuth",
    "pdf",
    "sample",
]
