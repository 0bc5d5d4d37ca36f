"""Fibres with a medulla that device tests share: every feature on and off, ordinary and extreme."""

from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.yan2015.parameters import Yan2015Fibre

FIBRES = {
    "human-black": Fibre.preset("human-black"),
    "raccoon": Fibre.preset("raccoon"),
    "red-fox": Fibre.preset("red-fox"),
    "clear": Fibre(kappa=0.0, alpha_deg=0.0),
    "coloured": Fibre(
        eta=1.5, kappa=0.7, alpha_deg=3, beta_m_deg=12, beta_n_deg=15, sigma_ca=(0.1, 0.3, 0.9),
        sigma_ms=2.0, sigma_ma=(0.0, 0.2, 1.0), g=-0.4, layers=1.3,
    ),
    "all medulla": Fibre(
        kappa=1.0, sigma_ms=2.0, sigma_ma=(0.1, 0.1, 0.1), g=0.6, layers=0.5, beta_m_deg=40,
        beta_n_deg=60,
    ),
}  # fmt: skip

# A medulla of nearly air, which reflects totally; denser than the cortex, with rays that miss it.
YAN2015 = {
    "air": Yan2015Fibre(
        eta=1.55, eta_m=1.1, kappa=0.6, beta_m_deg=8, beta_n_deg=12, sigma_ca=(0.1, 0.3, 0.9),
        sigma_ms=1.5, sigma_ma=(0.2, 0.2, 0.2), g=0.3, layers=0.6,
    ),
    "dense": Yan2015Fibre(
        eta=1.4, eta_m=1.7, kappa=0.43, beta_m_deg=8, beta_n_deg=12, sigma_ca=(0.1, 0.3, 0.9),
        sigma_ms=1.0, g=-0.2,
    ),
}  # fmt: skip
