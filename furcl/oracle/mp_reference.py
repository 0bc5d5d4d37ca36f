"""Attenuation and longitudinal density of the double cylinder at 60 digits.

Written straight from the defining formulas of docs/model.md, which cancel and overflow in float64:
what the float64 reference is held against. Needs mpmath, which the tests have and a render does
not.
"""

from __future__ import annotations

from typing import Any

from furcl.fibre.double_cylinder.parameters import Fibre

DIGITS = 60


def exact_attenuation(fibre: Fibre, h: float, theta: float) -> dict[str, Any]:
    """A_p of the first channel for a medulla that lets out all that it scatters.

    Parameters
    ----------
    h : float           offset, [-1, 1]
    theta : float       inclination of the known direction [rad], [-pi/2, pi/2]

    Returns
    -------
    {"R", "TT", "TRT", "TTs", "TRTs", "residual"} -> mpmath.mpf
    """
    import mpmath as mp

    with mp.workdps(DIGITS):
        offset, angle, eta, kappa, layers = (
            mp.mpf(x) for x in (h, theta, fibre.eta, fibre.kappa, fibre.layers)
        )
        # Snell's law and Fresnel's equations in three dimensions, then a pile of slabs.
        cos_in = mp.cos(angle) * mp.sqrt(1 - offset**2)
        cos_out = mp.sqrt(1 - (1 - cos_in**2) / eta**2)
        f_s = ((cos_in - eta * cos_out) / (cos_in + eta * cos_out)) ** 2
        f_p = ((eta * cos_in - cos_out) / (eta * cos_in + cos_out)) ** 2
        F = sum(2 * layers * f / (1 + (2 * layers - 1) * f) for f in (f_s, f_p)) / 2
        theta_t = mp.asin(mp.sin(angle) / eta)
        gamma_t = mp.asin(offset * mp.cos(angle) / (eta * mp.cos(theta_t)))
        inner = abs(mp.sin(gamma_t))
        s_m = mp.sqrt(kappa**2 - inner**2) if inner < kappa else mp.mpf(0)
        s_c = mp.cos(gamma_t) - s_m
        ca, ms, ma = (
            mp.mpf(x) / mp.cos(theta_t)
            for x in (fibre.sigma_ca[0], fibre.sigma_ms, fibre.sigma_ma[0])
        )
        T = mp.exp(-2 * s_c * ca - 2 * s_m * (ms + ma))
        q = 1 - mp.exp(-2 * s_m * ms)
        E = mp.exp(-(s_c + 1 - kappa) * ca) * q
        later = (1 - F) * F**2 * T**2 * ((1 - F) * T + E)
        return {
            "R": F,
            "TT": (1 - F) ** 2 * T,
            "TRT": (1 - F) ** 2 * F * T**2,
            "TTs": (1 - F) * E,
            "TRTs": (1 - F) * F * T * E,
            "residual": later / (1 - F * T) if F * T < 1 else mp.mpf(0),
        }


def exact_longitudinal(theta_o: float, mu: float, v: float) -> Any:
    """The longitudinal density m_p per unit of sin(theta_o), in d'Eon's form with csch and I0.

    Parameters
    ----------
    theta_o : float     outgoing inclination [rad]
    mu : float          centre [rad]
    v : float           variance [rad^2], > 0

    Returns
    -------
    mpmath.mpf
    """
    import mpmath as mp

    with mp.workdps(DIGITS):
        x = 1 / mp.mpf(v)
        along = mp.exp(mp.sin(mu) * mp.sin(theta_o) * x)
        around = mp.besseli(0, mp.cos(mu) * mp.cos(theta_o) * x)
        return mp.csch(x) * x / 2 * along * around
