"""The float64 reference itself against 60 digits, at the ends of the ranges."""

from __future__ import annotations

import importlib.util
import itertools
from typing import Any

import numpy as np

from furcl.bench.stability_row import Row
from furcl.fibre.double_cylinder import reference
from furcl.fibre.double_cylinder.parameters import Fibre
from furcl.fibre.double_cylinder.reference.angles import longitudinal
from furcl.oracle.mp_reference import exact_attenuation, exact_longitudinal

_FIBRES = (
    Fibre(),
    Fibre(eta=1.0001, layers=1e-3, sigma_ca=(1e-8, 1e-8, 1e-8)),
    Fibre(
        eta=3.0,
        layers=10.0,
        kappa=1.0 - 1e-6,
        sigma_ca=(50.0, 50.0, 50.0),
        sigma_ma=(1.0, 1.0, 1.0),
        sigma_ms=1e-8,
    ),
    Fibre(kappa=1e-6, sigma_ms=1e4, sigma_ma=(1e4, 1e4, 1e4), sigma_ca=(1e-3, 1e-3, 1e-3)),
    Fibre(kappa=1.0, sigma_ms=1e-3, sigma_ma=(1e-8, 1e-8, 1e-8)),
)
_THETAS = (0.0, 1e-9, 1.0, 1.57, np.pi / 2 - 1e-9)
_OFFSETS = (0.0, 1e-9, 0.5, 1 - 1e-9, 1.0)


def reference_rows() -> list[Row]:
    """Rows of the attenuation of R, TT and TRT and of the longitudinal density m_p.

    Without mpmath, which the tests need and a render does not, there are none.
    """
    if importlib.util.find_spec("mpmath") is None:
        return []
    return [_attenuation(), _longitudinal()]


def _attenuation() -> Row:
    row = Row("reference attenuation", "R TT TRT")
    for fibre, theta, h in itertools.product(_FIBRES, _THETAS, _OFFSETS):
        got = reference.attenuation(fibre, h, theta, reference.UNSCATTERED)
        exact = exact_attenuation(fibre, h, theta)
        for lobe in ("R", "TT", "TRT"):
            _score(row, float(got[lobe][0]), exact[lobe], f"{lobe}: {fibre}, {h}, {theta}")
    return row


def _longitudinal() -> Row:
    row = Row("reference density", "M")
    for beta, theta, mu in itertools.product(
        (1e-3, 0.03, 0.4, 2.5), (-1.5, 0.0, 0.7, 1.5707), (-1.5, 0.0, 0.7, 1.6)
    ):
        exact = exact_longitudinal(theta, mu, beta * beta)
        got = float(longitudinal(theta, mu, beta * beta))
        _score(row, got, exact, f"beta {beta}, theta {theta}, mu {mu}")
    return row


def _score(row: Row, got: float, exact: Any, where: str) -> None:
    row.points += 1
    error = float(abs(got - exact))
    row.max_absolute = max(row.max_absolute, error if float(exact) < 2.0 else 0.0)
    if float(exact) > 1e-12:
        relative = float(abs(got - exact) / exact)
        row.within_bars += relative <= 1e-9
        if relative > row.max_relative:
            row.max_relative, row.excess = relative, relative / 1e-9
            row.value, row.reference = got, float(exact)
            row.worst = {"where": where}
    else:
        row.within_bars += 1
