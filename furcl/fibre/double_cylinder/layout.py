"""What the double cylinder shares with its kernels: lobes, parameters, sizes of the profiles."""

from __future__ import annotations

from furcl.device.layout import Fields
from furcl.fibre.model import Lobe

LOBES = (
    Lobe("R", h_given_phi=True),
    Lobe("TT", h_given_phi=True),
    Lobe("TRT", h_given_phi=True),
    Lobe("TTs", narrow=False, h_given_phi=True),
    Lobe("TRTs", narrow=False, h_given_phi=True),
    Lobe("residual", narrow=False, h_given_phi=True),
)
SCATTERED = ("TTs", "TRTs")

# Profiles of the medulla (docs/model.md, Medulla): rows over cos(theta_t) and h with bins of phi;
# rows over theta_i with bins of s = sin(theta_o), of which each has a width of 1/32, in two bands.
PROFILE_TAUS = 4
PROFILE_OFFSETS = 32
PROFILE_PHIS = 128
PROFILE_THETAS = 16
PROFILE_SINES = PROFILE_PHIS // 2  # both bands together fill a row of phi: medulla_score.clh

# Tables of simulated scattering (docs/model.md, Simulated scattering): rows over sin(theta_i) and h
# with cells of phi by s; for light samples bands of |phi| by s, whatever h.
SIMULATED_THETAS = 8
SIMULATED_OFFSETS = 12
SIMULATED_PHIS = 32
SIMULATED_SINES = 64
SIMULATED_BANDS = 16

# Photons in which each row over theta_i has its turn, the last one nine times.
MEDULLA_CYCLE = 24

CONSTANTS: dict[str, int | str] = {
    "FURCL_PROFILE_TAUS": PROFILE_TAUS,
    "FURCL_PROFILE_OFFSETS": PROFILE_OFFSETS,
    "FURCL_PROFILE_PHIS": PROFILE_PHIS,
    "FURCL_PROFILE_THETAS": PROFILE_THETAS,
    "FURCL_PROFILE_SINES": PROFILE_SINES,
    "FURCL_MEDULLA_CYCLE": f"{MEDULLA_CYCLE}u",
    "FURCL_SIMULATED_THETAS": SIMULATED_THETAS,
    "FURCL_SIMULATED_OFFSETS": SIMULATED_OFFSETS,
    "FURCL_SIMULATED_PHIS": SIMULATED_PHIS,
    "FURCL_SIMULATED_SINES": SIMULATED_SINES,
    "FURCL_SIMULATED_BANDS": SIMULATED_BANDS,
}

STRUCT: Fields = (
    ("sigma_ca", "float4"),  # cortex absorption per fibre radius, one value a channel
    ("sigma_ma", "float4"),  # medulla absorption
    ("eta", "float"),
    ("eta_sq_minus_one", "float"),  # formed in float64: no cancellation near eta = 1
    ("kappa", "float"),
    ("one_minus_kappa", "float"),
    ("sigma_ms", "float"),
    ("layers", "float"),
    ("beta_m", "float"),
    ("beta_n", "float"),
    ("tilt", "float"),  # a <= 0 [rad]
    ("sin_tilt", "float"),
    ("cos_tilt", "float"),
    ("sin_tilt_trt", "float"),  # of 3 a
    ("cos_tilt_trt", "float"),
    ("profile_taus_per_cos", "float"),  # profile nodes per unit of 1 - cos(theta_t)
    ("kappa_low", "float"),  # what float32 leaves of kappa
    ("kappa_sq_e", "float"),  # kappa^2 (eta^2 - 1), and ...
    ("kappa_sq_e_low", "float"),  # ... what float32 leaves of it
    ("unused_1", "float"),
    ("unused_2", "float"),
    ("unused_3", "float"),
)


def profile_words(channels: int) -> int:
    """Words of the profiles with 0, 1 or 3 channels of absorption."""
    rows = PROFILE_TAUS * PROFILE_OFFSETS
    azimuth = rows * (PROFILE_PHIS * (1 + channels) + channels)
    return azimuth + 4 * PROFILE_THETAS * PROFILE_SINES


def simulated_words(channels: int) -> int:
    """Words of the tables of simulated scattering with 0, 1 or 3 channels of absorption; of three,
    every cell has three halves."""
    rows = SIMULATED_THETAS * SIMULATED_OFFSETS
    cells = rows * SIMULATED_PHIS * SIMULATED_SINES
    colours = 3 * cells // 2 if channels == 3 else 0
    bands = SIMULATED_THETAS * SIMULATED_BANDS * SIMULATED_SINES
    return rows * (channels + SIMULATED_PHIS) + cells + colours + bands
